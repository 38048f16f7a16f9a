"""`similarity --top`: of all policies the most similar."""

from typing import Any

from paddlectl.experiments.similar import most_similar, nearest_of_all
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from samples import BLOCKED_DOOR, GAP_BALL, TARGET, Command, add_source, program


def filled(place: Any) -> Registry:
    registry = Registry.open(place)
    for seed in range(3):
        add_source(registry, "BlockedDoor", program("BlockedDoor", BLOCKED_DOOR[seed:]), seed=seed)
        add_source(registry, "GapBall", program("GapBall", GAP_BALL), seed=seed, success_rate=0.9 - seed / 10)
    add_source(registry, "GapBall", None, method="ppo")
    add_source(registry, TARGET, program(TARGET, [("EX", "gt_blockage", 0.9)]))
    return registry


def test_the_nearest_policy_of_each_task_and_of_equals_the_best(tmp_path: Any) -> None:
    registry = filled(tmp_path / "registry")
    found = nearest_of_all(registry, load(TARGET), 5, 0.8, 0.2)
    assert [(each.policy, each.task) for each in found] == [
        ("policy-2", "GapBall"),
        ("policy-1", "BlockedDoor"),
    ]
    policies = [registry.policy(each.policy) for each in found]
    assert found == most_similar(registry, load(TARGET), policies, 0.8, 0.2)
    assert nearest_of_all(registry, load(TARGET), 1, 0.8, 0.2) == found[:1]


def test_the_command_tells_them_and_where_they_are_alike(tmp_path: Any, command: Command) -> None:
    registry = filled(tmp_path / "registry")
    top = ("similarity", "--target", TARGET, "--top", "2", "--registry", str(tmp_path / "registry"))
    found = command(*top, "--json").json
    assert found["sources"] == ["policy-2", "policy-1"]
    assert [each["policy"] for each in found["overall"]] == found["sources"]
    own = command(*top[:3], "--source", "policy-2", "--source", "policy-1", *top[5:], "--json").json
    assert found == own, "they are told as those are that a user names"
    shown = command(*top).out
    assert len(shown.splitlines()) <= 50
    scene = next(line for line in shown.splitlines() if line.startswith(" {has_key(env)} "))
    assert scene.split()[1:] == ["▆", "0.70*", "▆", "0.70*"]
    assert registry.policy("policy-2").task in shown


def test_what_it_refuses(tmp_path: Any, command: Command) -> None:
    place = ("--registry", str(tmp_path / "registry"))
    answer = command("similarity", "--target", TARGET, "--top", "2", "--source", "GapBall", *place)
    assert (answer.code, "--top and --source" in answer.err) == (2, True)
    registry = Registry.open(tmp_path / "registry")
    answer = command("similarity", "--target", TARGET, "--top", "2", *place)
    assert (answer.code, "no policy of another minigrid task" in answer.err) == (4, True)
    add_source(registry, "GapBall", "0.9 :: gt_key( :- p()")
    answer = command("similarity", "--target", TARGET, "--top", "2", *place)
    assert (answer.code, "the program of policy-1 is damaged" in answer.err) == (5, True)
