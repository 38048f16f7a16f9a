"""Why a transfer acted as it did, as one document made from what the run left; nothing is computed again."""

import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from paddlectl.errors import IntegrityError
from paddlectl.experiments.curves import WINDOW, in_order
from paddlectl.experiments.log import ended_episodes
from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RECORDINGS, RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.programs import program_document

TARGET = "target"
PHASES = ("early", "late")
MOST_TERMS = 12
"""Of one row of `reuse`."""
MANY = 10 * WINDOW
"""Episodes from which a run surely has enough for its figures."""

# What a run writes: the fields of each kind of row, and what their values are. Older runs lack those of MORE.
_MAPPING = {"target": str, "sources": [str], "scenes": list}
_SCENE = {"body": [str], "heads": [str], "self_similarity": float, "matches": list}
_MATCH = {"policy": str, "task": str, "similarity": float, "scenes": [[str]]}
_WEIGHING = {"policy": str, "similarity": float, "performance": float, "weight": float}
_WEIGHT = {"phase": str, "scene": [str], "decisions": int, "chosen": int, "reached": int, **_WEIGHING}
_WEIGHT_MORE = {"frames": int, "rules": {str: int}, "dropped": bool, "cut": int}
_DECISION = {
    "step": int,
    "scene": [str],
    "clause": str,
    "guide": str,
    "weights": list,
    "head": str,
    "steps": int,
    "reached": bool,
}
_DECISION_MORE = {"rule": str, "cut": bool}
_REUSE = {
    "frames": int,
    "context": [str],
    "source": str,
    "terms": {str: float},
    "weight": float,
    "chosen": int,
    "reached": int | None,
}
_MOMENT = {"frames": int, "scene": int, "chosen": int, **_WEIGHING}
_RECORDED = {
    "order": int,
    "frames": int,
    "score": float,
    "length": int,
    "action_repeat": int,
    "start": dict,
    "actions": list,
    "subgoals": list,
}
_GOAL = {"subgoal": str, "actions": int}
_OWN_TEXT = {"mapping", "trace", RECORDINGS}  # documents that are told each in a way of its own

_COUNT = range(2**63)
_LARGEST = sys.float_info.max


def explanation_document(registry: Registry, run: RunRecord, *, recorded: bool = True) -> dict[str, Any]:
    """The fields that `explain --json` promises, and the scores of the two traced episodes.

    `recordings` are the episodes that can be played again (`experiments.recordings`); they are left out
    without `recorded`.

    `program` and `source_programs` are programs as `show` gives them; `program` is null if the run stored no
    policy. `reuse` has the rows of `agents.base.ReuseRow`, `documents` what else the method has to tell.

    Raises:
        IntegrityError: If a file of the run isn't what a run writes.
    """
    files = registry.files
    mapping = files.read_document(run.id, "mapping")
    weights = weight_rows(registry, run)
    trace = files.read_document(run.id, "trace") or {}
    recordings = recordings_of(registry, run) if recorded else {}
    reuse = reuse_rows(registry, run)
    others = [name for name in files.document_names(run.id) if name not in _OWN_TEXT]
    told = {name: files.read_document(run.id, name) for name in others}
    _check(run.id, mapping, trace)
    for name, document in told.items():
        _demand(run.id, f"{name}.json", [document], {})
    return {
        "run": run.id,
        "method": run.method,
        "target": run.task,
        "sources": list(run.sources),
        "program": program_document(registry.policy(run.policy)) if run.policy else None,
        "source_programs": [
            program_document(registry.policy(source))
            for source in run.sources
            if not source.startswith(ELSEWHERE)
        ],  # those of an imported run are elsewhere
        "mapping": mapping,
        "weights": weights,
        "moments": moment_rows(registry, run),
        "reuse": reuse,
        "documents": told,
        "trace": [{"phase": phase, **decision} for phase in PHASES for decision in trace.get(phase, ())],
        "recordings": [{"phase": phase, **recordings[phase]} for phase in PHASES if phase in recordings],
        "final_episodes": final_episodes(registry, run),
        "trace_scores": {phase: trace.get(f"score_{phase}") for phase in PHASES},
    }


def final_episodes(registry: Registry, run: RunRecord) -> int | None:
    """How many episodes the figures of the end of training are over; None of many, or without figures."""
    if not (run.results and 0 < run.episodes < MANY):
        return None
    with suppress(IntegrityError):  # of an older run, too
        return min(WINDOW, len(in_order(ended_episodes(registry, run.id))))
    return None


def recordings_of(registry: Registry, run: RunRecord) -> dict[str, Any]:
    """The episodes that can be played again, by their phase; none if the run kept none.

    Raises:
        IntegrityError: If they aren't what a run writes.
    """
    found: dict[str, Any] = registry.files.read_document(run.id, RECORDINGS) or {}
    _check_recordings(run.id, found)
    return found


def weight_rows(registry: Registry, run: RunRecord) -> list[dict[str, Any]]:
    """The run's table `weights`, checked; empty if it has none.

    Raises:
        IntegrityError: If it isn't what a run writes.
    """
    rows = registry.files.read_rows(run.id, "weights")
    _demand(run.id, "weights.jsonl", rows, _WEIGHT, _WEIGHT_MORE)
    return rows


def moment_rows(registry: Registry, run: RunRecord) -> list[dict[str, Any]]:
    """The run's table `moments`, likewise."""
    rows = registry.files.read_rows(run.id, "moments")
    _demand(run.id, "moments.jsonl", rows, _MOMENT)
    return rows


def reuse_rows(registry: Registry, run: RunRecord) -> list[dict[str, Any]]:
    """The run's table `reuse`, likewise. Nobody is followed but the run's sources and the target."""
    rows = registry.files.read_rows(run.id, "reuse")
    _demand(run.id, "reuse.jsonl", rows, _REUSE)
    known = {TARGET, *(source.removeprefix(ELSEWHERE) for source in run.sources)}
    if not all(row["source"] in known and len(row["terms"]) <= MOST_TERMS for row in rows):
        raise _strange(run.id, "reuse.jsonl")
    return rows


def _check(run: str, mapping: Any, trace: Any) -> None:
    """Stored files are checked before anything leans on their fields."""
    if mapping is not None:
        _demand(run, "mapping.json", [mapping], _MAPPING)
        _demand(run, "mapping.json", mapping["scenes"], _SCENE)
        for scene in mapping["scenes"]:
            _demand(run, "mapping.json", scene["matches"], _MATCH)
    _demand(run, "trace.json", [trace], {})
    for phase in PHASES:
        _demand(run, "trace.json", [{"score": trace.get(f"score_{phase}", 0.0)}], {"score": float})
        _demand(run, "trace.json", trace.get(phase, []), _DECISION, _DECISION_MORE)
        for decision in trace.get(phase, []):
            _demand(run, "trace.json", decision["weights"], _WEIGHING)


def _check_recordings(run: str, recordings: Any) -> None:
    file = f"{RECORDINGS}.json"
    _demand(run, file, [recordings], {})
    for told in recordings.values():
        _demand(run, file, [told], _RECORDED)
        _demand(run, file, told["subgoals"], _GOAL)
        known = all(_is(int, action) or _is([float], action) for action in told["actions"])
        count, lasts = len(told["actions"]), told["action_repeat"]
        goals = sum(goal["actions"] for goal in told["subgoals"])
        if (
            not known
            or goals not in (0, count)
            or not max(0, count - 1) * lasts < told["length"] <= count * lasts
        ):
            raise _strange(run, file)


def _demand(
    run: str, file: str, rows: Any, fields: Mapping[str, Any], more: Mapping[str, Any] | None = None
) -> None:
    """Each row has these fields, and may have more."""
    sound = isinstance(rows, list) and all(
        isinstance(row, Mapping)
        and all(_is(kind, row.get(field)) for field, kind in fields.items())
        and all(_is(kind, row[field]) for field, kind in (more or {}).items() if field in row)
        for row in rows
    )
    if not sound:
        raise _strange(run, file)


def _strange(run: str, file: str) -> IntegrityError:
    return IntegrityError(f"{file} of {run} isn't what a run writes", "run that transfer again")


def _is(kind: Any, value: Any) -> bool:
    """Whether a JSON value is of a kind: a type, `[kind]` for a list of them, `{str: kind}` for an object.

    An int is a float too. No int is a negative one or longer than 63 bits, and no float is infinite.
    """
    if isinstance(kind, dict):
        return isinstance(value, dict) and all(_is(kind[str], item) for item in value.values())
    if isinstance(kind, list):
        return isinstance(value, list) and all(_is(kind[0], item) for item in value)
    if isinstance(value, bool):
        return kind is bool
    if kind is float:
        return isinstance(value, int | float) and -_LARGEST <= value <= _LARGEST
    return isinstance(value, kind) and not (isinstance(value, int) and value not in _COUNT)
