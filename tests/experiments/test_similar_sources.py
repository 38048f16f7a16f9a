"""Sources that are chosen by their similarity to the target, and what is said where there are too few."""

from collections.abc import Callable
from typing import Any

import pytest

from paddlectl.cli.similarity import similarity_document
from paddlectl.errors import NotFoundError
from paddlectl.experiments.sources import resolve, unlearned
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario, Similarity, SimilarSources
from paddlectl.tasks.suite import load
from samples import BLOCKED_DOOR, GAP_BALL, TARGET, add_source, program

CLAUSES = {"BlockedDoor": BLOCKED_DOOR, "GapBall": GAP_BALL, "BoxDoor": BLOCKED_DOOR[2:]}


@pytest.fixture
def registry(tmp_path: Any) -> Registry:
    return Registry.open(tmp_path / "registry")


@pytest.fixture
def learned(registry: Registry) -> Callable[..., str]:
    def add(task: str, method: str = "hdm", seed: int = 0, **more: Any) -> str:
        text = program(task, CLAUSES.get(task, GAP_BALL[:1])) if method == "hdm" else None
        return add_source(registry, task, text, method=method, seed=seed, **more)

    return add


def scenario(count: int, seed: Any = "best", **more: Any) -> Scenario:
    return Scenario(name="A", target=TARGET, sources=SimilarSources(auto=count, seed=seed), **more)


def overall(registry: Registry, policy: str, body: float = 0.8) -> float:
    """The mean ψ over all scenes, from what `similarity` tells of each."""
    document = similarity_document(load(TARGET), [registry.policy(policy)], body, 1.0 - body)
    found = [match["similarity"] for scene in document["scenes"] for match in scene["matches"]]
    return sum(found) / len(document["scenes"])


def test_the_most_similar_are_chosen_one_a_task_and_told(
    registry: Registry, learned: Callable[..., str]
) -> None:
    ids = {task: learned(task) for task in ("BlockedDoor", "GapBall", "BoxDoor", "OpenGoal")}
    learned("GapBall", success_rate=0.1)
    learned("BoxDoor", "ppo")
    learned(TARGET)
    add_source(registry, "MailMaze", None, domain="maze2d")
    psi = {policy: overall(registry, policy) for policy in ids.values()}
    best = sorted(psi, key=lambda policy: -psi[policy])
    for count in (1, 2, 4):
        found = resolve(registry, scenario(count), "paddle", (3, 1))
        assert found.required() == dict.fromkeys((3, 1), tuple(best[:count]))
        told = found.why[3]
        assert [(each.policy, each.similarity) for each in told] == [(p, psi[p]) for p in best[:count]]
        assert all(ids[each.task] == each.policy == each.program for each in told)


def test_the_scenarios_weights_count(registry: Registry, learned: Callable[..., str]) -> None:
    policy = learned("GapBall")
    heads = scenario(1, similarity=Similarity(body_weight=0.0, head_weight=1.0))
    (told,) = resolve(registry, heads, "paddle", (0,)).why[0]
    assert told.similarity == overall(registry, policy, 0.0) != overall(registry, policy)


def test_each_paired_seed_chooses_among_its_own(registry: Registry, learned: Callable[..., str]) -> None:
    first = {task: learned(task, seed=1) for task in ("BlockedDoor", "GapBall", "OpenGoal")}
    second = {task: learned(task, seed=2) for task in ("OpenGoal", "BoxDoor")}
    found = resolve(registry, scenario(2, "paired"), "paddle", (1, 2)).required()
    assert set(found[1]) == {first["BlockedDoor"], first["GapBall"]}
    assert set(found[2]) == set(second.values())


def test_a_flat_policy_is_as_similar_as_the_clauses_of_its_task(
    registry: Registry, learned: Callable[..., str]
) -> None:
    clauses = {task: learned(task) for task in ("BlockedDoor", "GapBall")}
    flat = {task: learned(task, "ppo") for task in ("GapBall", "BlockedDoor", "BoxDoor")}
    found = resolve(registry, scenario(2), "cup", (0,)).why[0]
    assert {each.policy for each in found} == {flat["BlockedDoor"], flat["GapBall"]}
    for each in found:
        assert each.program == clauses[each.task]
        assert each.similarity == overall(registry, each.program)
        assert str(each).endswith(f"ψ {each.similarity:.3f} by {each.program})")


def test_a_method_that_reuses_nothing_chooses_nothing(registry: Registry) -> None:
    assert resolve(registry, scenario(3), "hdm", (0, 1)).required() == {0: (), 1: ()}


FEW = [
    # (method, seed, what is told, what is to be run), where hdm has BlockedDoor of seed 1 and ppo GapBall
    ("paddle", "best", "auto: 3 policies by hdm are to be chosen of 1", "train GapBall DoorBall"),
    (
        "paddle",
        "paired",
        "auto: 3 policies by hdm with seeds 1-2 are to be chosen of 0",
        "train GapBall DoorBall --seeds 1-2, then paddlectl train BlockedDoor --seed 2",
    ),
    (
        "cup",
        "best",
        "auto: 3 policies by ppo are to be chosen of 0",
        "train GapBall DoorBall, then paddlectl train BlockedDoor DoorBall --method ppo",
    ),
]


@pytest.mark.parametrize(("method", "seed", "told", "run"), FEW, ids=[told for _, _, told, _ in FEW])
def test_too_few_are_told_with_what_mends_it(
    registry: Registry, learned: Callable[..., str], method: str, seed: str, told: str, run: str
) -> None:
    learned("BlockedDoor", seed=1)
    learned("GapBall", "ppo", seed=1)
    asked = scenario(3, seed)
    with pytest.raises(NotFoundError) as caught:
        resolve(registry, asked, method, (1, 2))
    assert (caught.value.message, caught.value.hint) == (told, f"run: paddlectl {run}")
    for command in run.split(", then paddlectl "):
        _, *words = command.split()
        by = words[words.index("--method") + 1] if "--method" in words else "hdm"
        seeds = {"--seeds": (1, 2), "--seed": (2,)}.get(
            next((w for w in words if w in ("--seeds", "--seed")), ""), (0,)
        )
        for task in [word for word in words if word in ("GapBall", "DoorBall", "BlockedDoor")]:
            for one in seeds:
                learned(task, by, seed=one)
    assert all(len(ids) == 3 for ids in resolve(registry, asked, method, (1, 2)).required().values())


def test_there_may_be_no_more_tasks(registry: Registry) -> None:
    with pytest.raises(NotFoundError) as caught:
        resolve(registry, scenario(60), "paddle", (0,))
    assert caught.value.hint.startswith("write auto: ") and "no more tasks beside" in caught.value.hint
    assert unlearned(scenario(2), "hdm", (0,)).command() == "paddlectl train BlockedDoor GapBall"


def test_a_paired_source_is_one_by_the_usual_numbers(registry: Registry, learned: Callable[..., str]) -> None:
    usual = learned("GapBall", seed=1)
    for unusual in ({"num_envs": 64}, {}):
        run = registry.add_run(
            kind="train", method="hdm", task="GapBall", scenario=None, sources=(), seed=1,
            settings={"unusual": unusual}, versions={},
        ).id  # fmt: skip
        old = registry.policy(usual)
        told = {
            k: getattr(old, k) for k in ("task", "domain", "method", "seed", "frames", "program", "metadata")
        }
        figures = ("success_rate", "mean_score", "mean_length", "crispness")
        newest = registry.add_policy(
            run=run, checkpoint=registry.read_checkpoint(old), **told, **{k: getattr(old, k) for k in figures}
        ).id
        found = resolve(registry, scenario(1, "paired"), "paddle", (1,)).required()[1]
        assert found == ((usual,) if unusual else (newest,))
