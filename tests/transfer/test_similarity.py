"""ψ and Ψ against tables worked by hand, with body_weight 0.8 and head_weight 0.2 unless said."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Scene, scenes_of
from paddlectl.logic.syntax import parse_clause
from paddlectl.transfer import similarity as module
from paddlectl.transfer.similarity import SceneMatch, map_scenes, similarity


def scene(heads, body):
    """`scene("gt_key gt_door", "a(), !b()")`: one scene with these heads."""
    tail = f" :- {body}" if body else ""
    (made,) = scenes_of([parse_clause(f"{head}(){tail}") for head in heads.split()])
    return made


TARGET = scene("gt_key gt_door", "p(), !q(), r(), !s()")

# heads and body of the source scene; shared literals of 4; shared heads of 2; ψ = 0.8·b/4 + 0.2·h/2
TABLE = [
    ("gt_key gt_door", "p(), !q(), r(), !s()", 4, 2, 1.0),
    ("gt_key", "p(), !q(), r(), !s()", 4, 1, 0.9),
    ("gt_ball", "p(), !q(), r(), !s()", 4, 0, 0.8),
    ("gt_door", "p(), !q(), r(), s()", 3, 1, 0.7),
    ("gt_ball gt_box", "p(), !q(), r(), s()", 3, 0, 0.6),
    ("gt_key gt_door gt_ball", "p(), !q(), !r(), s()", 2, 2, 0.6),
    ("gt_key", "!p(), q(), !r(), !s()", 1, 1, 0.3),
    ("gt_key", "!p(), q(), !r(), s()", 0, 1, 0.1),
    ("gt_ball", "!p(), q(), !r(), s()", 0, 0, 0.0),
    # other vocabularies: fewer atoms, more atoms, none in common, none at all
    ("gt_key", "!q(), r()", 2, 1, 0.5),
    ("gt_key", "p(), !q(), r(), !s(), t(), u()", 4, 1, 0.9),
    ("gt_key gt_door", "t(), u(agent)", 0, 2, 0.2),
    ("gt_door", "", 0, 1, 0.1),
    # the same name over other constants is another atom
    ("gt_ball", "p(agent), !q(agent), r(), s()", 1, 0, 0.2),
]


@pytest.mark.parametrize(("heads", "body", "literals", "shared_heads", "expected"), TABLE)
def test_similarity_as_worked_by_hand(heads, body, literals, shared_heads, expected):
    source = scene(heads, body)
    assert (len(TARGET.body & source.body), len(TARGET.heads & source.heads)) == (literals, shared_heads)
    assert similarity(TARGET, source) == expected


def test_both_shares_are_of_the_target():
    small, large = scene("gt_key", "p()"), scene("gt_key gt_door", "p(), q(), r(), s()")
    assert similarity(small, large) == 1.0
    assert similarity(large, small) == 0.3  # 0.8·1/4 + 0.2·1/2


def test_an_empty_side_of_the_target_has_nothing_to_share():
    anywhere = scene("gt_key", "")
    assert similarity(anywhere, anywhere) == 0.2
    assert similarity(anywhere, scene("gt_key", "p()")) == 0.2
    assert similarity(anywhere, scene("gt_ball", "")) == 0.0
    headless = Scene(TARGET.body, frozenset())
    assert similarity(headless, headless) == 0.8
    assert similarity(Scene(frozenset(), frozenset()), TARGET) == 0.0


def test_weights_are_the_users():
    source = scene("gt_key", "p(), !q(), !r(), s()")
    assert similarity(TARGET, source, 0.5, 0.5) == 0.5  # 0.5·2/4 + 0.5·1/2
    assert similarity(TARGET, source, 1.0, 0.0) == 0.5
    assert similarity(TARGET, source, 0.0, 1.0) == 0.5
    assert similarity(TARGET, source, 0.6, 0.4) == 0.5
    assert similarity(TARGET, source, 0.9, 0.2) == 0.55
    assert similarity(TARGET, source, 0.0, 0.0) == 0.0


@pytest.mark.parametrize("weights", [(-0.1, 0.2), (0.8, -0.1), (float("nan"), 0.2), (0.8, float("inf"))])
def test_impossible_weights_are_refused(weights):
    with pytest.raises(ValueError, match="weight"):
        similarity(TARGET, TARGET, *weights)
    with pytest.raises(ValueError, match="weight"):
        map_scenes([TARGET], {}, *weights)


# Two sources for a target of three scenes (see the rows below).
NO_KEY = scene("gt_key gt_door gt_ball", "!has_key(agent), !is_open(door)")
KEY = scene("gt_key gt_door gt_ball", "has_key(agent), !is_open(door)")
OPEN = scene("gt_key gt_door gt_ball", "has_key(agent), is_open(door)")

DOOR_BALL = (
    scene("gt_key", "!has_key(agent), !is_open(door)"),
    scene("gt_door", "has_key(agent), !is_open(door)"),
    scene("gt_ball", "!has_key(agent), is_open(door)"),
)
BOX_DOOR = (
    scene("gt_box", "!has_key(agent), !is_open(door), has_box(env)"),
    scene("gt_key gt_door", "!has_key(agent), !is_open(door), !has_box(env)"),
    scene("gt_key", "has_key(agent), !is_open(door), !has_box(env)"),
)


def test_scene_mapping_as_worked_by_hand():
    mapping = map_scenes([NO_KEY, KEY, OPEN], {"policy-1": DOOR_BALL, "policy-2": BOX_DOOR})
    assert mapping.rows == {
        # policy-1: 0.8·2/2 + 0.2·1/3; policy-2: 0.8·2/2 + 0.2·(0, 2)/3
        NO_KEY.body: (
            SceneMatch("policy-1", 13 / 15, (DOOR_BALL[0],)),
            SceneMatch("policy-2", 14 / 15, (BOX_DOOR[1],)),
        ),
        # both have the scene itself with one head of three
        KEY.body: (
            SceneMatch("policy-1", 13 / 15, (DOOR_BALL[1],)),
            SceneMatch("policy-2", 13 / 15, (BOX_DOOR[2],)),
        ),
        # policy-1: (0, 1, 1) literals and one head each, a tie; policy-2: (0, 0, 1) literals, (0, 2, 1) heads
        OPEN.body: (
            SceneMatch("policy-1", 7 / 15, (DOOR_BALL[1], DOOR_BALL[2])),
            SceneMatch("policy-2", 7 / 15, (BOX_DOOR[2],)),
        ),
    }
    assert list(mapping.rows) == [NO_KEY.body, KEY.body, OPEN.body]
    selves = [mapping.self_similarity(each.body) for each in (NO_KEY, KEY, OPEN)]
    assert selves == [14 / 15, 13 / 15, 7 / 15]


def test_body_and_head_shares_that_make_the_same_sum_tie_exactly():
    target = scene("gt_key", "p(), q(), r(), s()")
    by_body = scene("gt_ball", "p(), q(), r(), !s()")  # 0.8·3/4 + 0   = 0.6
    by_both = scene("gt_key", "p(), q(), !r(), !s()")  # 0.8·2/4 + 0.2 = 0.6
    less = scene("gt_ball", "p(), q(), !r(), s(), t()")  # as by_body: the extra atom costs nothing
    worse = scene("gt_ball", "p(), q(), !r(), !s(), t()")  # 0.4
    mapping = map_scenes([target], {"one": [worse, by_body, by_both, less]})
    assert mapping.rows[target.body] == (SceneMatch("one", 0.6, (by_body, by_both, less)),)


def test_ties_of_thirds_and_sevenths_are_exact():
    target = scene("h1 h2 h3", ", ".join(f"p{index}()" for index in range(7)))
    # 0.7·b/7 + 0.3·h/3 = 0.1·(b + h)
    tied = [
        scene("h1 h2 h3", "p0(), p1()"),
        scene("h1 h2", "p0(), p1(), p2()"),
        scene("h1", "p0(), p1(), p2(), p3()"),
        scene("h9", "p0(), p1(), p2(), p3(), p4()"),
    ]
    mapping = map_scenes([target], {"one": tied}, 0.7, 0.3)
    assert mapping.rows[target.body] == (SceneMatch("one", 0.5, tuple(tied)),)


def test_a_new_best_stands_once_and_drops_the_old_ones():
    low, high = scene("gt_key", "p(), q(), !r(), s()"), scene("gt_key", "p(), !q(), r(), !s()")
    (match,) = map_scenes([TARGET], {"one": [low, high]}).rows[TARGET.body]
    assert match == SceneMatch("one", 0.9, (high,))


def test_a_source_that_shares_nothing_offers_all_its_scenes_at_zero():
    strangers = (scene("gt_ball", "t()"), scene("gt_box", ""))
    (match,) = map_scenes([TARGET], {"one": strangers}).rows[TARGET.body]
    assert match == SceneMatch("one", 0.0, strangers)


def test_an_empty_source_has_no_scene_to_offer():
    mapping = map_scenes([TARGET], {"none": (), "one": [TARGET]})
    assert mapping.rows[TARGET.body] == (SceneMatch("none", 0.0, ()), SceneMatch("one", 1.0, (TARGET,)))
    assert mapping.self_similarity(TARGET.body) == 1.0


def test_without_sources_every_scene_has_an_empty_row():
    mapping = map_scenes([NO_KEY, KEY], {})
    assert mapping.rows == {NO_KEY.body: (), KEY.body: ()}
    assert mapping.self_similarity(KEY.body) == 0.0
    with pytest.raises(KeyError):
        mapping.self_similarity(OPEN.body)


def test_an_empty_target_body_is_matched_by_its_heads_alone():
    anywhere = scene("gt_key gt_door", "")
    mapping = map_scenes([anywhere], {"one": DOOR_BALL})
    assert mapping.rows[frozenset()] == (SceneMatch("one", 0.1, DOOR_BALL[:2]),)


def test_two_target_scenes_with_one_body_are_refused():
    with pytest.raises(ValueError, match="share a body"):
        map_scenes([scene("gt_key", "p()"), scene("gt_door", "p()")], {})


PREDICATES = tuple(Predicate(name, 0)() for name in "pqrst")
HEADS = tuple(Predicate(name, 0)() for name in ("gt_key", "gt_door", "gt_ball"))
SCENES = st.builds(
    Scene,
    st.dictionaries(st.sampled_from(PREDICATES), st.booleans()).map(
        lambda signs: frozenset(Literal(atom, sign) for atom, sign in signs.items())
    ),
    st.frozensets(st.sampled_from(HEADS)),
)


@given(
    st.lists(SCENES, unique_by=lambda each: each.body, max_size=4),
    st.lists(st.lists(SCENES, max_size=4), max_size=4),
)
@settings(deadline=None)
def test_mapping_agrees_with_similarity(target, programs):
    sources = {f"policy-{index}": program for index, program in enumerate(programs)}
    mapping = map_scenes(target, sources)
    for each in target:
        row = mapping.rows[each.body]
        assert [match.policy for match in row] == list(sources)
        for match in row:
            found = [similarity(each, other) for other in sources[match.policy]]
            assert match.similarity == max(found, default=0.0) <= 1.0
            best = [
                s for s, value in zip(sources[match.policy], found, strict=True) if value == match.similarity
            ]
            assert list(match.scenes) == best
        assert mapping.self_similarity(each.body) == max((match.similarity for match in row), default=0.0)


def test_of_many_sources_with_few_programs_each_program_is_matched_once(monkeypatch):
    matched, usual = [], module._best_scenes
    monkeypatch.setattr(module, "_best_scenes", lambda *given: matched.append(given) or usual(*given))
    sources = {f"policy-{index}": list((DOOR_BALL, BOX_DOOR)[index % 2]) for index in range(1000)}
    mapping = map_scenes([NO_KEY, KEY, OPEN], sources)
    assert [match.policy for match in mapping.rows[KEY.body]] == list(sources)
    assert len(matched) == 3 * 2  # scenes, programs
