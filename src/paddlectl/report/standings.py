"""Who led in which scene and phase: what the rows of weights.jsonl say, and which subgoals it was for."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from paddlectl.report.explanation import TARGET
from paddlectl.report.output import clean

Document = Mapping[str, Any]


@dataclass(frozen=True)
class Standing:
    """One policy in one scene and phase; ψ, Φ and Λ as they were at the end of the phase.

    Attributes:
        rules: Rule -> decisions in which the policy led by it; None if the run didn't record it.
        dropped: It wasn't asked here any more at the end of the phase.
        cut: Decisions that the horizon cut off: neither reached nor missed.
    """

    policy: str
    similarity: float
    performance: float
    weight: float
    chosen: int
    reached: int
    rules: Mapping[str, int] | None = None
    dropped: bool = False
    cut: int = 0

    @property
    def reached_share(self) -> float | None:
        """Of its decisions that ended within the horizon; None if there was none."""
        ended = self.chosen - self.cut
        return self.reached / ended if ended > 0 else None


@dataclass(frozen=True)
class SceneMet:
    """What happened in one scene.

    Attributes:
        decisions: Phase -> how often the scene came up.
        standings: Phase -> its policies, the one chosen most often first.
    """

    body: tuple[str, ...]
    decisions: Mapping[str, int]
    standings: Mapping[str, tuple[Standing, ...]]

    @property
    def total(self) -> int:
        return sum(self.decisions.values())


def scenes_met(rows: Iterable[Document]) -> list[SceneMet]:
    """Groups the rows of weights.jsonl by scene, most frequent first, without those that never came up."""
    grouped: dict[tuple[str, ...], dict[str, dict[str, list[Document]]]] = {}
    for row in rows:
        phases = grouped.setdefault(tuple(row["scene"]), {})
        phases.setdefault(row["phase"], {}).setdefault(row["policy"], []).append(row)
    scenes = [_scene(body, phases) for body, phases in grouped.items()]
    return sorted((scene for scene in scenes if scene.total), key=lambda scene: -scene.total)


def _scene(body: tuple[str, ...], phases: Mapping[str, Mapping[str, Sequence[Document]]]) -> SceneMet:
    decisions = {
        phase: sum(row["decisions"] for row in next(iter(policies.values())))
        for phase, policies in phases.items()
    }
    standings = {
        phase: tuple(sorted((_standing(rows) for rows in policies.values()), key=lambda one: -one.chosen))
        for phase, policies in phases.items()
        if decisions[phase]
    }
    return SceneMet(body, decisions, standings)


def _standing(rows: Sequence[Document]) -> Standing:
    last = rows[-1]
    return Standing(
        last["policy"],
        last["similarity"],
        last["performance"],
        last["weight"],
        sum(row["chosen"] for row in rows),
        sum(row["reached"] for row in rows),
        _rules(rows),
        last.get("dropped", False),
        sum(row.get("cut", 0) for row in rows),
    )


def _rules(rows: Sequence[Document]) -> dict[str, int] | None:
    """The counts of all rows; None if one of them has none."""
    if any("rules" not in row for row in rows):
        return None
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row["rules"])
    return dict(total)


class Subgoals:
    """The subgoals that a program picks in a target scene, by way of the scenes that Ψ maps it to."""

    def __init__(self, document: Document) -> None:
        programs = {program["policy"]: program for program in document["source_programs"]}
        if document["program"]:
            programs[TARGET] = document["program"]
        self._best = {policy: _best_heads(program["clauses"]) for policy, program in programs.items()}
        self._mapped = {
            (tuple(scene["body"]), match["policy"]): [tuple(body) for body in match["scenes"]]
            for scene in (document["mapping"] or {"scenes": ()})["scenes"]
            for match in scene["matches"]
        }

    def __call__(self, policy: str, body: tuple[str, ...]) -> str:
        bodies = self._mapped.get((body, policy), [body])
        best = self._best.get(policy, {})
        return clean(" or ".join(sorted({best[mapped] for mapped in bodies if mapped in best})))


def _best_heads(clauses: Iterable[Document]) -> dict[tuple[str, ...], str]:
    """Body -> the head of its most probable clause."""
    rising = sorted(clauses, key=lambda clause: float(clause["probability"]))
    return {tuple(clause["body"]): clause["head"] for clause in rising}
