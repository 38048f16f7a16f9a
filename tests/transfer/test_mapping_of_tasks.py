"""Ψ of BlockedBoxUnlockPickup against BlockedDoor and GapBall, worked by hand, through the command itself.

Letters stand for facts: K has_key(agent), E has_key(env), B has_blockage(agent), G has_ball(agent),
O is_open(door), X is_blocked(door). A scene is the letters that hold; every other fact of its task doesn't.

The target has six facts and seven heads. Every source scene has five of those facts, and one head that
the target has too, so with b shared literals ψ = 4/5·b/6 + 1/5·1/7 = (14·b + 3)/105.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import save

from paddlectl.registry.store import Registry
from samples import FACTS, ROOT

TARGET = "BlockedBoxUnlockPickup"
LETTERS = {"BlockedDoor": "KEBOX", "GapBall": "KEGOX", TARGET: "KEBGOX"}

BLOCKED_DOOR = """
0.98 :: gt_blockage() :- !has_key(agent), has_key(env), !has_blockage(agent), !is_open(door), is_blocked(door)
0.9 :: put_blockage() :- !has_key(agent), has_key(env), has_blockage(agent), !is_open(door), !is_blocked(door)
0.99 :: gt_key() :- !has_key(agent), has_key(env), !has_blockage(agent), !is_open(door), !is_blocked(door)
0.96 :: gt_door() :- has_key(agent), !has_key(env), !has_blockage(agent), !is_open(door), !is_blocked(door)
"""  # scenes EX, EB, E, K
GAP_BALL = """
0.99 :: gt_box() :- !has_key(agent), !has_key(env), !has_ball(agent), !is_open(door), !is_blocked(door)
0.98 :: gt_key() :- !has_key(agent), has_key(env), !has_ball(agent), !is_open(door), !is_blocked(door)
0.95 :: put_key() :- has_key(agent), !has_key(env), !has_ball(agent), is_open(door), !is_blocked(door)
0.94 :: gt_ball() :- !has_key(agent), has_key(env), !has_ball(agent), is_open(door), !is_blocked(door)
"""  # scenes "", E, KO, EO

FIVE, FOUR, THREE = 73 / 105, 59 / 105, 45 / 105

# target scene; BlockedDoor's ψ and best scenes; GapBall's ψ and best scenes. Above each row the shared
# literals of five, in the order of the programs: BlockedDoor's EX EB E K (without G), GapBall's "" E KO EO
# (without B).
TABLE = [
    # 5 3 4 2; 3 4 1 3
    ("EX", FIVE, ["EX"], FOUR, ["E"]),
    # 4 2 3 3; 4 3 2 2
    ("X", FOUR, ["EX"], FOUR, [""]),
    # 3 3 2 2; 4 3 2 2: another thing than the blockage in hand lies before the door
    ("BX", THREE, ["EX", "EB"], FOUR, [""]),
    # 2 4 3 3; 5 4 3 3
    ("B", FOUR, ["EB"], FIVE, [""]),
    # 3 5 4 2; 4 5 2 4
    ("EB", FIVE, ["EB"], FIVE, ["E"]),
    # 4 4 5 3; 4 5 2 4
    ("E", FIVE, ["E"], FIVE, ["E"]),
    # 3 3 4 4; 5 4 3 3
    ("", FOUR, ["E", "K"], FIVE, [""]),
    # 2 2 3 5; 4 3 4 2
    ("K", FIVE, ["K"], FOUR, ["", "KO"]),
    # 3 1 2 4; 3 2 3 1
    ("KX", FOUR, ["K"], THREE, ["", "KO"]),
    # 1 1 2 4; 3 2 5 3
    ("KO", FOUR, ["K"], FIVE, ["KO"]),
    # 2 0 1 3; 2 1 4 2
    ("KOX", THREE, ["K"], FOUR, ["KO"]),
    # 3 3 4 2; 3 4 3 5
    ("EO", FOUR, ["E"], FIVE, ["EO"]),
    # 4 2 3 1; 2 3 2 4
    ("EOX", FOUR, ["EX"], FOUR, ["EO"]),
    # 3 3 4 2; 2 3 2 4: the ball in hand is no fact of BlockedDoor
    ("EGO", FOUR, ["E"], FOUR, ["EO"]),
    # 3 3 4 4; 4 3 2 2
    ("G", FOUR, ["E", "K"], FOUR, [""]),
    # 4 2 3 3; 3 2 1 1
    ("GX", FOUR, ["EX"], THREE, [""]),
    # 1 3 2 2; 4 3 4 4
    ("BO", THREE, ["EB"], FOUR, ["", "KO", "EO"]),
]


def body(task, true):
    """The literals of a scene, sorted by atom."""
    atoms = sorted(FACTS[letter] for letter in LETTERS[task])
    return [atom if atom in {FACTS[letter] for letter in true} else f"!{atom}" for atom in atoms]


def add_policy(registry, task, program):
    run = registry.add_run(
        kind="train", method="hdm", task=task, scenario=None, sources=(), seed=0, settings={}, versions={}
    )
    return registry.add_policy(
        run=run.id,
        task=task,
        domain="minigrid",
        method="hdm",
        seed=0,
        frames=1000,
        program=program,
        checkpoint=save({"weights": np.zeros(2, np.float32)}),
        success_rate=1.0,
        mean_score=0.9,
        mean_length=30.0,
        crispness=0.94,
        metadata={},
    )


@pytest.fixture(scope="module")
def registry(tmp_path_factory):
    made = Registry.open(tmp_path_factory.mktemp("mapping") / "registry")
    add_policy(made, "BlockedDoor", BLOCKED_DOOR)
    add_policy(made, "GapBall", GAP_BALL)
    return made.location


def similarity(registry, *options):
    line = [sys.executable, "-m", "paddlectl", "similarity", "--target", TARGET, "--registry", registry]
    line += ["--source", "BlockedDoor", "--source", "GapBall", "--json", *options]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def document(registry):
    return similarity(registry)


def row(document, true):
    (found,) = [scene for scene in document["scenes"] if scene["body"] == body(TARGET, true)]
    return found


@pytest.mark.parametrize(("true", "by_door", "door_scenes", "by_gap", "gap_scenes"), TABLE)
def test_matches_as_worked_by_hand(document, true, by_door, door_scenes, by_gap, gap_scenes):
    found = row(document, true)
    assert found["matches"] == [
        {
            "policy": policy,
            "task": task,
            "similarity": psi,
            "scenes": [body(task, letters) for letters in scenes],
        }
        for policy, task, psi, scenes in [
            ("policy-1", "BlockedDoor", by_door, door_scenes),
            ("policy-2", "GapBall", by_gap, gap_scenes),
        ]
    ]
    assert found["self_similarity"] == max(by_door, by_gap)


def test_the_target_is_its_complete_clause_set(document):
    assert (document["target"], document["body_weight"], document["head_weight"]) == (TARGET, 0.8, 0.2)
    assert document["sources"] == ["policy-1", "policy-2"]
    heads = "gt_ball gt_blockage gt_box gt_door gt_key put_blockage put_key"
    assert all(scene["heads"] == [f"{head}()" for head in heads.split()] for scene in document["scenes"])
    # of 64 assignments those with at most one of K, B, G in hand and not both K and E: none in hand 8,
    # K (no E) 4, B 8, G 8
    assert len(document["scenes"]) == 28
    assert len({tuple(scene["body"]) for scene in document["scenes"]}) == 28


def test_other_weights_make_other_similarities_of_the_same_matches(registry):
    document = similarity(registry, "--body-weight", "0.5")
    assert (document["body_weight"], document["head_weight"]) == (0.5, 0.5)
    # 1/2·5/6 + 1/2·1/7 = 41/84; 1/2·4/6 + 1/14 = 17/42
    assert [match["similarity"] for match in row(document, "EX")["matches"]] == [41 / 84, 17 / 42]
    assert row(document, "EX")["self_similarity"] == 41 / 84
    assert row(document, "")["matches"][0]["scenes"] == [body("BlockedDoor", "E"), body("BlockedDoor", "K")]
