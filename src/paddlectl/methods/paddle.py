"""PADDLE (Algorithm 2): the guides collect, the target learns."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np
import torch

from paddlectl.agents import recording
from paddlectl.agents.base import Episode, ReuseRow, Tables
from paddlectl.agents.settings import changed
from paddlectl.hybrid.agent import HybridAgent
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.settings import USUAL, HybridSettings, settings_for, settings_from
from paddlectl.learners.base import Actor, Learner
from paddlectl.learners.frozen import FrozenActor
from paddlectl.logic.clauses import Scene, scenes_of
from paddlectl.methods.base import Method, Setup
from paddlectl.scenario import Scenario, Similarity
from paddlectl.tasks.base import Task
from paddlectl.transfer import guides
from paddlectl.transfer.candidates import Source, candidates_of, inherited_program, most_similar_first
from paddlectl.transfer.documents import mapping_document
from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.transfer.recorder import GuideRecorder
from paddlectl.transfer.similarity import SceneMapping, map_scenes

PAPER_STEPS = 50
"""Most of a decision in `guidance: paper`; with half of them it gives up what nobody taught the target."""
MOMENTS = 100
"""Of a run, at which it is told who led."""

_MAZE = USUAL["maze2d"]
GUIDED: Mapping[str, HybridSettings] = {
    "maze2d": replace(
        _MAZE,
        num_envs=1,
        rollout_steps=256,
        action_repeat=5,
        credit=replace(_MAZE.credit, imitation_margin=0.02),
        clauses=replace(_MAZE.clauses, step_discount=0.998),
        decisions=replace(_MAZE.decisions, reward_unit=60.0),
    ),
}
"""How a target is learned from guides, by domain; of one that isn't here, as a source is.

In the maze the ways that they know are gone faster with an action every 5 steps. One lane plays: of many that
start at once, all would make the same mistakes. Hindsight has taught the source that it inherits from to go
from most places to most others, and what it lacks it takes from the other guides (`cloning`): in the few
updates that a transfer has time for, TD3 would unlearn more than it would add. A step costs 0.09 of a score
near 40, hence its discount. Rewards are counted such that what the first order of play that works is worth
stays below ψ in most scenes, so that guides which weren't asked there yet are asked once.
"""

GUIDANCE: Mapping[str, GuidanceSettings] = {
    "maze2d": GuidanceSettings(similarity_decay=0.3),
}
"""By domain; of one that isn't here, the defaults.

In the maze a decision that fails takes a third of an episode, so that guides are soon judged by what came of
them, and the target is heard less often.
"""


class PaddleAgent(HybridAgent):
    """Algorithm 2.

    At each decision the scene is looked up in Ψ and the candidate of largest Λ leads (lines 5-14,
    `GuideSelector.select`); its return is taken down (lines 16-19, `GuideSelector.on_decision_end`); after
    each rollout the target learns from all of it (line 22). The sources stay as they are.

    It keeps the weights of the first hundred episodes, and of the last tenth of the run; shorter, those at a
    hundred moments; and the decisions of the two episodes that can be played again.
    """

    def __init__(
        self,
        target: HybridPolicy,
        sources: Sequence[Source],
        selector: guides.GuideSelector,
        mapping: Mapping[str, Any],
        seed: int,
        frames: int,
    ) -> None:
        rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0].spawn(1)[0])
        actors: list[Actor] = [
            target.low_level,
            *(FrozenActor(each.low_level, each.digest) for each in sources),
        ]
        super().__init__(target, selector, actors, rng, [selector])
        self.guides = selector
        self._recorder = GuideRecorder(selector, sources)
        self._mapping = mapping
        self._frames = frames
        self._phase, self._since, self._now, self._moment = "early", 0, 0, 0
        self._choice = recording.Choice()
        self._trace: dict[str, Any] = {}

    def reuse(self) -> Sequence[ReuseRow]:
        """Who led in the phase so far; ψ, Φ and Λ as of now."""
        return [
            ReuseRow(
                row["frames"],
                tuple(row["scene"]),
                row["policy"],
                {"ψ": row["similarity"], "Φ": row["performance"]},
                row["weight"],
                row["chosen"],
                row["reached"],
            )
            for row in self._recorder.weights(self._phase, self._now)
        ]

    def record(self, frames: int, episodes: Sequence[Episode], known: int) -> Tables:
        """The weights at each moment, and those at the end of the early phase."""
        for episode, decisions in zip(episodes, self.guides.traces, strict=True):
            self._keep_trace(episode, decisions)
        self.guides.traces.clear()
        self._now, tenth = frames, self._frames // 10
        if self._phase == "early" and known >= recording.EARLY:
            tables = self.close()
            self._phase, self._since = "late", frames
            self._recorder.clear()
            return tables
        if self._phase == "late" and self._frames - frames >= tenth <= frames - self._since:
            moments = self._moments()
            self._since = frames
            self._recorder.clear()
            return moments
        return self._moments() if frames - self._moment >= self._frames / MOMENTS else {}

    def close(self) -> Tables:
        """The weights as of now."""
        return {**self._moments(), **self._weights()}

    def _moments(self) -> Tables:
        self._moment = self._now
        return {"moments": list(self._recorder.moment(self._now))}

    def _weights(self) -> Tables:
        return {"weights": list(self._recorder.weights(self._phase, self._now))}

    def documents(self) -> Mapping[str, Any]:
        """Ψ, and an episode of each phase decision by decision, once there is one."""
        return {"mapping": self._mapping, **({"trace": self._trace} if self._trace else {})}

    def _keep_trace(self, episode: Episode, decisions: Sequence[guides.TracedDecision]) -> None:
        """Of the two episodes that can be played again."""
        phase = self._choice.phase(episode)
        if phase is not None:
            self._trace[phase] = self._recorder.trace(decisions)
            self._trace[f"score_{phase}"] = episode.score


def make(setup: Setup) -> PaddleAgent:
    """The target with its guides; by default it inherits the most similar one's low level."""
    scenario: Scenario = setup.scenario
    target = HybridPolicy(setup.task, setup.seed, setup.settings)
    sources = [_guide(source) for source in setup.sources]
    mapping, document = _mapping(target, sources, scenario.similarity)
    num_envs, sharpness = target.settings.num_envs, target.settings.sharpness
    readings = scenario.guidance.readings()
    softness = readings.source_softness if readings else 0.0
    candidates = candidates_of(target.task, target.clauses.bodies, sources, mapping, sharpness, softness)
    rng = np.random.default_rng(setup.seed)
    if readings:
        selector: guides.GuideSelector = guides.PaperGuides(target, candidates, num_envs, rng, readings)
    else:
        selector = guides.PlannedGuides(target, candidates, num_envs, rng, setup.rules)
        target.clauses.prefer(inherited_program(target.task, candidates, setup.rules.program_inheritance))
        _warm_start(target, sources, mapping, setup.rules.inheritance)
    return PaddleAgent(target, sources, selector, document, setup.seed, setup.frames)


def _guide(source: Any) -> Source:
    def low_level() -> Learner:
        policy: HybridPolicy = source.revive()
        return policy.low_level

    task = source.task
    return Source(source.id, task.name, task.subgoals, source.program, low_level, source.digest)


def _mapping(
    target: HybridPolicy, sources: Sequence[Source], weights: Similarity
) -> tuple[SceneMapping, dict[str, Any]]:
    scenes = [Scene(body, frozenset(target.task.subgoals)) for body in target.clauses.bodies]
    programs = {source.policy: scenes_of(source.program.clauses) for source in sources}
    mapping = map_scenes(scenes, programs, weights.body_weight, weights.head_weight)
    tasks = {source.policy: source.task for source in sources}
    name = target.task.name
    return mapping, mapping_document(name, scenes, mapping, tasks, weights.body_weight, weights.head_weight)


def _warm_start(target: HybridPolicy, sources: Sequence[Source], mapping: SceneMapping, share: float) -> None:
    """The most similar of the sources whose networks have the target's shape hands them on."""
    for source in most_similar_first(sources, mapping) if share else ():
        theirs = source.low_level().state()
        if _shapes(theirs) == _shapes(target.low_level.state()):
            target.low_level.warm_start(theirs, share)
            return


def _shapes(state: Mapping[str, torch.Tensor]) -> dict[str, tuple[int, ...]]:
    return {name: tuple(tensor.shape) for name, tensor in state.items()}


def _settings(task: Task, scenario: Scenario, *changes: Mapping[str, Any]) -> HybridSettings:
    """Those of `hdm`; who inherits learns by `GUIDED`, `guidance: paper` by its readings."""
    readings, usual = scenario.guidance.readings(), settings_for(task)
    if readings is None:
        return reduce(changed, changes, _presets(task).get("guided", usual))
    as_in_paper = {
        "num_envs": readings.num_envs,
        "rollout_steps": max(1, usual.num_envs * usual.rollout_steps // readings.num_envs),
        "decisions": {"max_steps": PAPER_STEPS, "patience": 1.0},
        "credit": {"imitation_margin": readings.imitation_margin},
    }
    return settings_for(task, as_in_paper, *changes)


def _presets(task: Task) -> Mapping[str, HybridSettings]:
    """`guided`, by which policies of older versions may be kept."""
    known = task.domain in GUIDED
    return {"guided": replace(GUIDED[task.domain], frames=task.frames)} if known else {}


def _rules(task: Task) -> GuidanceSettings:
    return GUIDANCE.get(task.domain, GuidanceSettings())


PADDLE = Method(
    name="paddle",
    settings_for=_settings,
    settings_from=settings_from,
    rules_for=_rules,
    make=make,
    policy=HybridPolicy,
    presets=_presets,
)
