"""Algorithm 2 on scripted outcomes: who may lead, what is recorded, who leads then."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from paddlectl.agents.evaluation import evaluate
from paddlectl.agents.interaction import Learning
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.rollout import PROGRESS, DecisionSettings, Outcome
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.buffers import TARGET
from paddlectl.learners.clauses import ClauseSettings
from paddlectl.learners.ppo import PPO, PPOSettings
from paddlectl.logic.clauses import Scene, scenes_of
from paddlectl.logic.syntax import parse_program
from paddlectl.methods.paddle import PaddleAgent
from paddlectl.transfer import guides
from paddlectl.transfer.candidates import Source, candidates_of, most_similar_first
from paddlectl.transfer.guidance import GuidanceSettings, PaperSettings
from paddlectl.transfer.recorder import GuideRecorder
from paddlectl.transfer.similarity import map_scenes
from scripted import END, FAR_SCENE, NEAR_SCENE, RIGHT, STAY, TASK, TWO, ByScript, Corridor, outcome

NEVER = -np.inf
SMALL = HybridSettings(num_envs=4, rollout_steps=16, low_level=PPOSettings(epochs=1))

# Four scenes; lit() is an atom that the target hasn't.
LAMP = """
0.9 :: gt_two() :- !far(), lit()
0.8 :: gt_end() :- !far(), !lit()
0.6 :: gt_end() :- far()
0.2 :: gt_two() :- far()
"""
WALK = "1.0 :: gt_end() :- far()"


def target(seed=0, settings=SMALL):
    return HybridPolicy(TASK, seed, settings)


def sources(*programs, actor=None):
    return [
        Source(
            f"policy-{number}",
            f"Task{number}",
            TASK.subgoals,
            parse_program(text),
            lambda: actor or ByScript(RIGHT),
            "",
        )
        for number, text in enumerate(programs, start=1)
    ]


def candidates(policy, given, sharpness=1.0):
    bodies = policy.clauses.bodies
    scenes = [Scene(body, frozenset(TASK.subgoals)) for body in bodies]
    mapping = map_scenes(scenes, {each.policy: scenes_of(each.program.clauses) for each in given})
    return candidates_of(TASK, bodies, given, mapping, sharpness)


def test_every_scene_that_is_a_best_match_is_a_candidate():
    made = candidates(target(), sources(LAMP, WALK))
    assert made.guides.tolist() == [TARGET, 1, 1, 1, 2]
    # body 1 of 1 and subgoals 1 of 3: 0.8 + 0.2/3 = 13/15; subgoals 2 of 3: 14/15; the subgoal alone: 1/15
    near = [13 / 15, 13 / 15, 13 / 15, NEVER, 1 / 15]
    far = [14 / 15, NEVER, NEVER, 14 / 15, 13 / 15]
    assert made.similarity == pytest.approx(np.array([near, far]))
    assert made.subgoals[1:].argmax(-1).tolist() == [TWO, END, END, END]


def test_a_candidate_plays_its_scenes_distribution_sharpened():
    soft = candidates(target(), sources(LAMP))
    assert soft.subgoals[3] == pytest.approx([0.0, 0.25, 0.75, 0.0])
    sharp = candidates(target(), sources(LAMP), sharpness=2.0)
    assert sharp.subgoals[3] == pytest.approx([0.0, 0.1, 0.9, 0.0])
    assert soft.subgoals[1:].sum(-1) == pytest.approx(np.ones(3))
    entropy = -0.75 * math.log(0.75) - 0.25 * math.log(0.25)  # of the program, sharpened or not
    for made in (soft, sharp):
        assert made.entropy == pytest.approx([0.0, 0.0, 0.0, entropy])


def test_a_source_without_clauses_is_no_candidate():
    made = candidates(target(), sources("", WALK))
    assert made.guides.tolist() == [TARGET, 2]
    assert candidates(target(), sources("")).guides.tolist() == [TARGET]


def test_subgoals_that_the_target_lacks_can_be_led_to():
    made = candidates(target(), sources("1.0 :: gt_other() :- far()"))
    assert made.subgoals[1].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert made.similarity[FAR_SCENE, 1] == pytest.approx(0.8)


LETTER = PaperSettings(1.0, "clip", 0.0, "per_guide", 0.0, 0.0)
"""The equations as printed."""
GUIDED = GuidanceSettings(episodes="guided")


def one_of_each(mode, policy, given, num_envs=1, seed=0, readings=LETTER, rules=GUIDED):
    made = candidates(policy, given)
    rng = np.random.default_rng(seed)
    selector = (
        guides.PaperGuides(policy, made, num_envs, rng, readings)
        if mode == "paper"
        else guides.PlannedGuides(policy, made, num_envs, rng, rules)
    )
    selector.refresh()
    return selector


def learning(policy, given, selector, seed, frames):
    environment = policy.task.make(policy.settings.num_envs, seed, policy.action_repeat)
    return Learning(environment, PaddleAgent(policy, given, selector, {}, seed, frames), frames)


def decide(selector, scene, lane=0):
    guides, subgoals = selector.select(np.array([lane]), np.array([scene * PROGRESS]))
    return int(guides[0]), int(subgoals[0])


def tell(selector, scene, subgoal, reward, following=None, reached=False, lane=0):
    """What came of the lane's decision; the episode is over if nothing follows."""
    selector.on_decision_end(outcome(scene * PROGRESS, subgoal, reward, following, reached, lane))


def play(selector, steps, lane=0):
    """An episode of (scene, reward) decisions; gives the guides that led."""
    led = []
    for number, (scene, reward) in enumerate(steps):
        guide, subgoal = decide(selector, scene, lane)
        following = steps[number + 1][0] if number + 1 < len(steps) else None
        tell(selector, scene, subgoal, reward, following, lane=lane)
        led.append(guide)
    return led


def test_paper_records_the_discounted_return_of_every_decision():
    """Algorithm 2, line 18, with γ = 0.5: rewards 0, 0.2, 0.8 give returns 0.3, 0.6, 0.8."""
    policy = target(settings=HybridSettings(clauses=ClauseSettings(discount=0.5)))
    selector = one_of_each("paper", policy, sources("1.0 :: gt_two() :- !far()\n1.0 :: gt_end() :- far()"))
    before = selector.weigh()
    assert (before.performance == 1.0).all(), "a constant before the first sample"
    # of the source and the target, which tie at ψ + 1, the source leads everywhere
    assert play(selector, [(NEAR_SCENE, 0.0), (FAR_SCENE, 0.2), (NEAR_SCENE, 0.8)]) == [1, 1, 1]
    after = selector.weigh()
    # near: the mean of 0.3 and 0.8; far: 0.6; candidate 1 is its near scene, 2 the far one
    expected = np.ones((2, 3))
    expected[NEAR_SCENE, 1], expected[FAR_SCENE, 2] = 0.55, 0.6
    assert after.performance == pytest.approx(np.repeat(expected, PROGRESS, axis=0))
    finite = np.isfinite(after.similarity)
    assert after.weight[finite] == pytest.approx((after.similarity + after.performance)[finite])
    assert (after.weight[~finite] == NEVER).all()


def test_paper_keeps_lanes_apart_and_counts_finished_episodes_only():
    policy = target(settings=HybridSettings(clauses=ClauseSettings(discount=0.5)))
    selector = one_of_each("paper", policy, sources("1.0 :: gt_end() :- far()"), num_envs=2)
    _, subgoal = decide(selector, FAR_SCENE, lane=0)
    decide(selector, FAR_SCENE, lane=1)
    tell(selector, FAR_SCENE, subgoal, 0.3, following=FAR_SCENE, lane=0)
    assert selector.weigh().performance[FAR_SCENE * PROGRESS, 1] == 1.0
    tell(selector, FAR_SCENE, subgoal, 0.5, lane=1)
    assert selector.weigh().performance[FAR_SCENE * PROGRESS, 1] == pytest.approx(0.5)
    assert decide(selector, FAR_SCENE, lane=0)[0] == TARGET
    tell(selector, FAR_SCENE, subgoal, 0.1, lane=0)
    # the target: 0.1; the source: the mean of 0.5 and 0.3 + 0.5·0.1
    assert selector.weigh().performance[FAR_SCENE * PROGRESS] == pytest.approx([0.1, 0.425])


def test_paper_keeps_values_of_subgoals_from_first_visits_and_failures_cost():
    """γ = 0.5, a miss costs 0.1: -0.1, 0.1, 0.7 give 0.125, 0.45, 0.7; near is visited twice."""
    policy = target(settings=HybridSettings(clauses=ClauseSettings(discount=0.5)))
    with torch.no_grad():
        policy.clauses.weights.zero_()
    given = sources("1.0 :: gt_two() :- !far()\n1.0 :: gt_end() :- far()")
    selector = one_of_each(
        "paper", policy, given, readings=PaperSettings(failure_cost=0.1, source_softness=0.0)
    )
    assert play(selector, [(NEAR_SCENE, 0.0), (FAR_SCENE, 0.2), (NEAR_SCENE, 0.8)]) == [1, 1, 1]
    found = selector.weigh().performance[[NEAR_SCENE * PROGRESS, FAR_SCENE * PROGRESS]]
    # the target picks each of three subgoals alike; candidate 1 always gt_two, 2 always gt_end
    assert found == pytest.approx(np.array([[0.125 / 3, 0.125, 0.0], [0.45 / 3, 0.0, 0.45]]))


def test_negative_returns_show_unless_they_are_clipped():
    for normalise, shown in (("none", -0.1), ("clip", 0.0)):
        readings = PaperSettings(0.0, normalise, 0.1, "per_guide", 0.0)
        selector = one_of_each("paper", target(), sources(WALK), readings=readings)
        assert play(selector, [(FAR_SCENE, 0.0)]) == [1]
        assert selector.weigh().performance[FAR_SCENE * PROGRESS, 1] == pytest.approx(shown)
        # a source that failed makes way for a target that was never asked, or it doesn't
        assert play(selector, [(FAR_SCENE, 0.0)]) == [TARGET if normalise == "none" else 1]


def test_a_decision_that_the_horizon_cut_off_costs_nothing():
    for mode in ("paper", "default"):
        selector = one_of_each(mode, target(), sources(WALK), readings=PaperSettings(failure_cost=0.1))
        _, subgoal = decide(selector, FAR_SCENE)
        ended = dict(lanes=0, scene_states=FAR_SCENE * PROGRESS, subgoals=subgoal, guides=1, steps=3)
        ended |= dict(rewards=0.0, reached=False, cut=True, terminated=False, solved=False, truncated=True)
        columns = {name: np.array([value]) for name, value in ended.items()}
        selector.on_decision_end(Outcome(**columns, next_scene_states=np.array([FAR_SCENE * PROGRESS])))
        assert len(selector.traces) == 1
        assert selector.traces[0][0].cut
        assert (selector.chosen.sum(), selector.reached.sum(), selector.cut.sum()) == (1, 0, 1)
        if mode == "paper":
            assert selector.weigh().performance[FAR_SCENE * PROGRESS, 1] == 0.0


def test_a_soft_source_plays_some_of_every_subgoal_of_its_task():
    given = sources("1.0 :: gt_end() :- far()")
    bodies = target().clauses.bodies
    mapping = map_scenes(
        [Scene(body, frozenset(TASK.subgoals)) for body in bodies],
        {"policy-1": scenes_of(given[0].program.clauses)},
    )
    made = candidates_of(TASK, bodies, given, mapping, 3.0, softness=0.3)
    # three subgoals of the task, the domain's first not among them
    assert made.subgoals[1] == pytest.approx([0.0, 0.1, 0.8, 0.1])
    assert made.entropy[1] == pytest.approx(-0.8 * math.log(0.8) - 0.2 * math.log(0.1))


def test_paper_turns_to_the_target_when_it_is_worth_more():
    selector = one_of_each("paper", target(), sources("1.0 :: gt_end() :- far()"))
    assert play(selector, [(FAR_SCENE, 0.4)]) == [1]
    # ψ + 0.4 against the target's ψ + 1, which then earns 0.1 and loses its place again
    assert play(selector, [(FAR_SCENE, 0.1)]) == [TARGET]
    assert play(selector, [(FAR_SCENE, 0.4)]) == [1]


def test_the_exploration_bonus_of_the_target_is_its_own_entropy():
    policy = target()
    with torch.no_grad():
        policy.clauses.weights.zero_()
    selector = one_of_each("paper", policy, sources(WALK))
    play(selector, [(FAR_SCENE, 0.4)])
    assert play(selector, [(FAR_SCENE, -0.04)]) == [TARGET]
    # -0.04 + 0.04·ln 3
    assert selector.weigh().performance[FAR_SCENE * PROGRESS, TARGET] == pytest.approx(
        0.04 * (math.log(3) - 1)
    )


def last_guides(selector, worth, scene=FAR_SCENE, episodes=150, last=50):
    """Who led the last of many one-decision episodes, in which guide g earns worth[g]."""
    led = []
    for _ in range(episodes):
        guide, subgoal = decide(selector, scene)
        earned = worth.get(guide, 0.0)
        tell(selector, scene, subgoal, earned, reached=earned > 0)
        led.append(guide)
    return led[0], np.bincount(led[-last:], minlength=3) / last


def test_where_the_source_always_fails_the_target_explores():
    first, shares = last_guides(one_of_each("default", target(), sources(WALK)), {})
    assert first == 1
    assert shares[TARGET] >= 0.9


def test_where_no_source_helps_the_target_explores():
    first, shares = last_guides(one_of_each("default", target(), sources(WALK, LAMP)), {})
    assert first != TARGET
    assert shares[TARGET] >= 0.9


def test_a_source_that_helps_is_kept():
    for worth in ({1: 0.9}, {1: 0.5}):
        _, shares = last_guides(one_of_each("default", target(), sources(WALK)), worth)
        assert shares[1] >= 0.8


def test_the_better_source_leads_whatever_its_similarity():
    selector = one_of_each("default", target(), sources(WALK, LAMP))
    _, shares = last_guides(selector, {1: 0.8, 2: 0.1}, episodes=400)
    assert shares[1] >= 0.8


def test_the_target_takes_over_where_it_is_better():
    """It is measured in the episodes that it leads alone."""
    selector = one_of_each("default", target(), sources(WALK), rules=GuidanceSettings())
    _, shares = last_guides(selector, {TARGET: 0.9, 1: 0.3}, episodes=600)
    assert shares[TARGET] >= 0.9


def test_a_guide_that_was_in_vain_is_not_asked_again_in_this_episode():
    """Two sources match alike; the first to be asked fails, and the episode stays where it was."""
    first_again = 0
    for seed in range(40):
        selector = one_of_each("default", target(), sources(WALK, "1.0 :: gt_two() :- far()"), seed=seed)
        guide, subgoal = decide(selector, FAR_SCENE)
        tell(selector, FAR_SCENE, subgoal, 0.0, following=FAR_SCENE)
        first_again += decide(selector, FAR_SCENE)[0] == guide
    assert first_again <= 4


def test_even_the_best_source_is_not_asked_twice_in_vain():
    selector = one_of_each("default", target(), sources(WALK, "1.0 :: gt_two() :- far()"))
    last_guides(selector, {1: 0.9, 2: 0.75})
    led = []
    for _ in range(10):
        first, subgoal = decide(selector, FAR_SCENE)
        tell(selector, FAR_SCENE, subgoal, 0.0, following=FAR_SCENE)
        second, subgoal = decide(selector, FAR_SCENE)
        tell(selector, FAR_SCENE, subgoal, 0.9, reached=True)
        led.append((first, second))
    assert sum(first == 1 for first, _ in led) >= 7
    assert (1, 1) not in led


def test_the_next_episode_forgives():
    """A source that is worth a lot is asked first, though its last decision of the last episode failed."""
    selector = one_of_each("default", target(), sources(WALK))
    last_guides(selector, {1: 0.9}, episodes=30)
    asked = 0
    for _ in range(10):
        guide, subgoal = decide(selector, FAR_SCENE)
        asked += guide == 1
        tell(selector, FAR_SCENE, subgoal, 0.0, following=FAR_SCENE)
        _, subgoal = decide(selector, FAR_SCENE)
        tell(selector, FAR_SCENE, subgoal, 0.9, reached=True)
    assert asked >= 8


def test_two_sources_that_undo_each_other_are_seen_through():
    """Source 1 gets from near to far and from far to the end; source 2, better matched, leads back."""
    on = "1.0 :: gt_end() :- !far()\n1.0 :: gt_end() :- far()"
    back = "0.5 :: gt_two() :- far()\n0.5 :: gt_moon() :- far()"
    selector = one_of_each("default", target(), sources(on, back))
    decisions = []
    for _ in range(80):
        scene, count, score = NEAR_SCENE, 0, 0.0
        while score == 0.0 and count < 12:
            guide, subgoal = decide(selector, scene)
            count += 1
            following = scene
            if guide == 1 and scene == FAR_SCENE:
                score = 0.9
            elif guide == 1:
                following = FAR_SCENE
            elif guide == 2:
                following = NEAR_SCENE
            over = score > 0 or count == 12
            tell(selector, scene, subgoal, score, None if over else following, reached=guide > 0)
            scene = following
        decisions.append(count)
    assert np.mean(decisions[-40:]) <= 3.5


def test_the_most_similar_source_is_that_of_the_largest_similarity_over_all_scenes():
    policy, given = target(), sources("1.0 :: gt_end() :- far()", LAMP, WALK)
    scenes = [Scene(body, frozenset(TASK.subgoals)) for body in policy.clauses.bodies]
    mapping = map_scenes(scenes, {each.policy: scenes_of(each.program.clauses) for each in given})
    # 1/15 + 13/15 for WALK, 13/15 + 14/15 for LAMP
    assert most_similar_first(given, mapping)[0].policy == "policy-2"
    assert most_similar_first(given[::2], mapping)[0].policy == "policy-1"


def test_a_source_gets_its_share_of_the_time_and_the_target_all_of_it():
    decisions = DecisionSettings(max_steps=6, patience=0.5)
    settings = HybridSettings(num_envs=2, rollout_steps=16, decisions=decisions)
    policy, given = target(settings=settings), sources(WALK, actor=ByScript(STAY))
    selector = one_of_each("default", policy, given, num_envs=2)
    for _ in learning(policy, given, selector, 0, 2000):
        pass
    guided, own = [], []
    for decision in (d for episode in selector.traces for d in episode):
        if decision.steps > 1:
            (own if decision.candidate == TARGET else guided).append(decision.steps)
    assert max(guided) == 3
    assert max(own) == 6


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_the_record_of_what_was_decided(mode):
    selector = one_of_each(mode, target(), sources(WALK), num_envs=2)
    guides, subgoals = selector.select(np.array([0, 1]), np.array([FAR_SCENE, NEAR_SCENE]) * PROGRESS)
    tell(selector, FAR_SCENE, subgoals[0], 0.1, following=NEAR_SCENE, reached=True, lane=0)
    tell(selector, NEAR_SCENE, subgoals[1], 0.0, lane=1)
    guide, subgoal = decide(selector, NEAR_SCENE, lane=0)
    tell(selector, NEAR_SCENE, subgoal, 0.0, lane=0)
    short, long = selector.traces
    assert [(d.scene_state // PROGRESS, d.subgoal, d.reached, d.steps) for d in short] == [
        (NEAR_SCENE, subgoals[1], False, 3)
    ]
    assert [(d.scene_state // PROGRESS, d.reached) for d in long] == [(FAR_SCENE, True), (NEAR_SCENE, False)]
    assert [selector.candidates.guides[d.candidate] for d in long] == [guides[0], guide]
    assert (selector.decisions.sum(), selector.chosen.sum(), selector.reached.sum()) == (3, 3, 1)
    selector.clear()
    assert (selector.traces, selector.decisions.sum(), selector.chosen.sum()) == ([], 0, 0)


def learn(mode, seed, actor=None, frames=640, watch=lambda selector, given: None):
    policy = target(seed)
    given = sources("1.0 :: gt_end() :- !far()\n1.0 :: gt_end() :- far()", actor=actor)
    selector = one_of_each(mode, policy, given, num_envs=SMALL.num_envs, seed=seed)
    rounds = []
    for round_ in learning(policy, given, selector, seed, frames):
        rounds.append(round_)
        watch(selector, given)
    return policy.state(), rounds, [episode for round_ in rounds for episode in round_.episodes]


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_a_transfer_is_a_function_of_its_seed(mode):
    state, rounds, episodes = learn(mode, 3)
    torch.manual_seed(99)
    same_state, _, same_episodes = learn(mode, 3)
    assert episodes == same_episodes
    assert all(torch.equal(state[name], same_state[name]) for name in state)
    assert learn(mode, 4)[2] != episodes
    assert [r.frames for r in rounds] == list(range(64, 641, 64))


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_to_look_at_a_run_changes_nothing(mode):
    """With what `explain` reads written every round, and without, the same policy comes out."""

    def watch(selector, given):
        assert list(GuideRecorder(selector, given).weights("late", 0))
        first, again = selector.weigh(), selector.weigh()
        assert all(np.array_equal(one, other) for one, other in zip(first, again, strict=True))

    plain, _, episodes = learn(mode, 3)
    watched, _, same = learn(mode, 3, watch=watch)
    assert episodes == same
    assert all(torch.equal(plain[name], watched[name]) for name in plain)


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_who_led_so_far_is_told_in_the_terms_of_every_method(mode):
    policy, given = target(), sources(LAMP, WALK)
    made = learning(policy, given, one_of_each(mode, policy, given, SMALL.num_envs), 0, 512)
    assert made.agent.reuse() == []
    next(made)
    told, selector = made.agent.reuse(), made.agent.guides
    assert sum(row.chosen for row in told) == selector.decisions.sum() > 0
    assert sum(row.reached for row in told) == selector.reached.sum()
    assert {row.source for row in told} == {"target", "policy-1", "policy-2"}
    assert {row.context for row in told} <= {("!far()",), ("far()",)}
    assert all(row.terms.keys() == {"ψ", "Φ"} and np.isfinite(row.weight) for row in told)
    assert told == made.agent.reuse()


def test_nothing_is_told_of_guides_before_the_first_decision():
    policy, given = target(), sources(LAMP)
    selector = guides.PaperGuides(policy, candidates(policy, given), 4, np.random.default_rng(0), LETTER)
    agent = PaddleAgent(policy, given, selector, {}, 0, 512)
    assert (agent.reuse(), agent.close()) == ([], {"moments": [], "weights": []})


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_every_decision_is_told_at_one_moment_of_the_run(mode):
    policy, given = target(), sources(LAMP, WALK)
    made = learning(policy, given, one_of_each(mode, policy, given, SMALL.num_envs), 0, 6400)
    tables, decided, known = [], 0, 0
    counted = made.agent.guides.clear

    def clear():
        nonlocal decided
        decided += made.agent.guides.decisions.sum()
        counted()

    made.agent.guides.clear = clear
    for round_ in made:
        known += len(round_.episodes)
        tables.append(made.agent.record(round_.frames, round_.episodes, known))
    decided += made.agent.guides.decisions.sum()
    tables.append(made.agent.close())
    rows = [row for table in tables for row in table.get("moments", ())]
    assert sum(row["chosen"] for row in rows) == decided > 0
    assert len({row["frames"] for row in rows}) > 50
    assert {row["policy"] for row in rows} == {"target", "policy-1", "policy-2"}
    assert {row["scene"] for row in rows} <= set(range(len(policy.clauses.bodies)))
    assert len([table for table in tables if "weights" in table]) == 2  # of the early phase, and of the late


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_sources_stay_as_they_are(mode):
    actor = PPO(Corridor.observation_size, Corridor.actions.size, 8)
    before = {name: tensor.clone() for name, tensor in actor.state().items()}
    learn(mode, 0, actor=actor, frames=256)
    assert all(torch.equal(before[name], tensor) for name, tensor in actor.state().items())


def test_a_good_source_gives_a_jump_start_and_its_skill_is_learned():
    state, rounds, _ = learn("default", 0, frames=1600)
    early = sorted((e for r in rounds for e in r.episodes), key=lambda e: e.order)[:20]
    assert np.mean([e.score > 0 for e in early]) >= 0.4  # at random it is hardly ever solved
    taught = target()
    taught.load(state)
    alone = evaluate(taught, TASK, 20, 7)
    untaught = evaluate(target(), TASK, 20, 7)
    assert alone.success_rate > untaught.success_rate


def test_evaluation_never_plays_the_layouts_that_were_trained_on():
    """Whatever the seeds: a user may well give the same one to `transfer` and `evaluate`."""
    made = []

    def make(num_envs, seed, action_repeat=1, split="training"):
        made.append(split)
        return Corridor(num_envs, 0, action_repeat)

    policy = HybridPolicy(replace(TASK, make=make), 0, SMALL)
    made.clear()
    given = sources(WALK)
    selector = one_of_each("paper", policy, given, num_envs=SMALL.num_envs)
    list(learning(policy, given, selector, 5, 64))
    trained_on = set(made)
    made.clear()
    evaluate(policy, policy.task, 4, 5)
    assert trained_on
    assert trained_on.isdisjoint(made)
