"""A registry filled through its own interface with two small sources and one transfer, all worked by hand."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import safetensors.numpy
from sqlalchemy import update

from paddlectl.cli.similarity import similarity_document
from paddlectl.registry.index.entry import publish
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from paddlectl.studies.results import Result
from paddlectl.tasks.suite import load

ROOT = Path(__file__).parents[1]
TARGET = "BlockedBoxUnlockPickup"

# (true facts, head, probability); the letters of FACTS
BLOCKED_DOOR = [
    ("EX", "gt_blockage", 0.98),
    ("EB", "put_blockage", 0.97),
    ("E", "gt_key", 0.99),
    ("K", "gt_door", 0.96),
]
GAP_BALL = [
    ("", "gt_box", 0.99),
    ("E", "gt_key", 0.98),
    ("KO", "put_key", 0.95),
    ("EO", "gt_ball", 0.85),
    ("EO", "gt_key", 0.15),
]
FACTS = {
    "K": "has_key(agent)",
    "E": "has_key(env)",
    "B": "has_blockage(agent)",
    "G": "has_ball(agent)",
    "O": "is_open(door)",
    "X": "is_blocked(door)",
}


def body(task: str, true: str) -> list[str]:
    """The scene of a task in which exactly these facts hold."""
    holding = {FACTS[letter] for letter in true}
    atoms = sorted(load(task).vocabulary.atoms)
    return [str(atom) if str(atom) in holding else f"!{atom}" for atom in atoms]


def program(task: str, clauses: list[tuple[str, str, float]]) -> str:
    return "\n".join(f"{p!r} :: {head}() :- {', '.join(body(task, true))}" for true, head, p in clauses)


class Answer(NamedTuple):
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Command = Callable[..., Answer]


def add_source(
    registry: Registry,
    task: str,
    text: str | None,
    domain: str = "minigrid",
    method: str = "hdm",
    seed: int = 0,
    success_rate: float = 0.97,
) -> str:
    """The id of its policy."""
    run = registry.add_run(
        kind="train", method=method, task=task, scenario=None, sources=(), seed=seed, settings={}, versions={}
    )
    policy = add_policy(registry, run.id, task, text, domain, method, seed, success_rate)
    registry.finish_run(
        run.id, status="finished", frames=1000, episodes=10, seconds=2.0, results={"success_rate": 0.97}
    )
    return policy


def add_policy(
    registry: Registry,
    run: str,
    task: str,
    text: str | None,
    domain: str = "minigrid",
    method: str = "hdm",
    seed: int = 0,
    success_rate: float = 0.97,
) -> str:
    return registry.add_policy(
        run=run,
        task=task,
        domain=domain,
        method=method,
        seed=seed,
        frames=1000,
        program=text,
        checkpoint=safetensors.numpy.save({"weights": np.frombuffer(task.encode(), np.uint8)}),
        success_rate=success_rate,
        mean_score=0.93,
        mean_length=30.0,
        crispness=0.96,
        metadata={},
    ).id


def add_transfer(registry: Registry, scenario: str = "A") -> None:
    sources = [registry.policy("policy-1"), registry.policy("policy-2")]
    run = registry.add_run(
        kind="transfer",
        method="paddle",
        task=TARGET,
        scenario=scenario,
        sources=[source.id for source in sources],
        seed=0,
        settings={},
        versions={},
    )
    registry.files.write_document(run.id, "mapping", similarity_document(load(TARGET), sources, 0.8, 0.2))
    registry.files.append_rows(run.id, "weights", weight_rows())
    registry.files.write_document(
        run.id, "trace", {"early": [decision()], "late": [], "score_early": 0.9, "score_late": 0.0}
    )
    add_policy(registry, run.id, TARGET, program(TARGET, [("EX", "gt_blockage", 0.9), ("X", "gt_box", 0.8)]))
    registry.finish_run(
        run.id,
        status="finished",
        frames=60_000,
        episodes=900,
        seconds=20.0,
        results={
            "jump_start": 0.7,
            "final_score": 0.88,
            "final_success": 0.9,
            "area_under_curve": 0.8,
            "success_rate": 0.97,
        },
    )


def reuse(registry: Registry, run: str, sources: Sequence[str]) -> None:
    """Makes a run one that reuses these policies, also such as only an import can name."""
    with registry.index.writing() as connection:
        row = update(runs).where(runs.c.id == int(run.partition("-")[2]))
        connection.execute(row.values(sources=json.dumps(list(sources))))


def reseal(registry: Registry, name: str) -> None:
    """Makes a run's manifest say that its files are as they should be, as only one who means harm would."""
    with registry.index.writing() as connection:
        publish(registry.folder, connection, name)


def weight_rows() -> list[dict[str, Any]]:
    rows = [
        # phase, true facts, policy, task, ψ, Φ, Λ, decisions, chosen, reached, rules
        ("early", "EX", "policy-1", "BlockedDoor", 0.695, 0.41, 1.105, 400, 384, 365, {"largest": 384}),
        ("early", "EX", "policy-2", "GapBall", 0.562, 0.2, 0.762, 400, 12, 3, {"penalty": 12}),
        ("early", "EX", "target", TARGET, 0.695, 0.0, 0.695, 400, 4, 0, {"alone": 4}),
        ("late", "EX", "policy-1", "BlockedDoor", 0.695, 0.5, 1.195, 100, 30, 30, {"largest": 30}),
        ("late", "EX", "policy-2", "GapBall", 0.562, 0.2, 0.762, 100, 0, 0, {}),
        ("late", "EX", "target", TARGET, 0.695, 0.55, 1.245, 100, 70, 70, {"largest": 63, "alone": 7}),
        ("early", "E", "policy-2", "GapBall", 0.695, 0.3, 0.995, 50, 50, 25, {"largest": 50}),
    ]
    fields = ("phase", "scene", "policy", "task", "similarity", "performance", "weight")
    counts = ("decisions", "chosen", "reached", "rules")
    more = {"frames": 100}
    found = [dict(zip(fields + counts, row, strict=True)) | more for row in rows]
    return [row | {"scene": body(TARGET, str(row["scene"]))} for row in found]


def decision() -> dict[str, Any]:
    return {
        "step": 0,
        "scene": body(TARGET, "EX"),
        "clause": program("BlockedDoor", BLOCKED_DOOR[:1]).partition(":: ")[2],
        "guide": "policy-1",
        "weights": [
            {"policy": "policy-1", "similarity": 0.695, "performance": 0.41, "weight": 1.105},
            {"policy": "policy-2", "similarity": 0.562, "performance": 0.2, "weight": 0.762},
            {"policy": "target", "similarity": 0.695, "performance": 0.0, "weight": 0.695},
        ],
        "head": "gt_blockage()",
        "steps": 12,
        "reached": True,
        "rule": "largest",
    }


def recording(task: str = TARGET, *goals: str) -> dict[str, Any]:
    """An episode, as a run keeps it, in which all is done in vain; it goes for each of these in turn."""
    engine: Any = load(task).make(1, 0)
    actions = np.random.default_rng(0).integers(4, size=load(task).horizon).tolist()
    each = len(actions) // max(1, len(goals))
    counts = [each] * (len(goals) - 1) + [len(actions) - each * (len(goals) - 1)]
    return {
        "order": 4,
        "frames": 5000,
        "score": 0.0,
        "length": len(actions),
        "action_repeat": 1,
        "start": engine.start(0),
        "actions": actions,
        "subgoals": [{"subgoal": goal, "actions": n} for goal, n in zip(goals, counts, strict=bool(goals))],
    }


SCENARIO = """\
name: A
target: BlockedBoxUnlockPickup
sources: [BlockedDoor, GapBall]
method: paddle
seeds: [0, 1, 2]
frames: 400000
similarity: {body_weight: 0.8, head_weight: 0.2}
guidance: {mode: default}
"""

RESULT = Result(
    scenario="A", target="BoxDoor", method="paddle", variant="", seed=0, run="run-1", code="", frames=1000,
    episodes=200, seconds=1.0, source_frames=0, jump_start=0.0, final_score=0.0, final_success=0.0,
    area_under_curve=0.0, frames_to_success=None, unseen_success=0.0, unseen_length=0.0,
    by_frames=(0.5,) * 100, by_episodes=(0.5,) * 4,
)  # fmt: skip
