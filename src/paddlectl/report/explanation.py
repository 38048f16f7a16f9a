"""Why a transfer acted as it did, as one document made from what the run left; nothing is computed again."""

from collections.abc import Mapping
from typing import Any

from paddlectl.errors import IntegrityError
from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.programs import program_document

TARGET = "target"
PHASES = ("early", "late")

# What a run writes: the fields of each kind of row, and what their values are. Older runs lack those of MORE.
_MAPPING = {"target": str, "sources": [str], "scenes": list}
_SCENE = {"body": [str], "heads": [str], "self_similarity": float, "matches": list}
_MATCH = {"policy": str, "task": str, "similarity": float, "scenes": [[str]]}
_WEIGHING = {"policy": str, "similarity": float, "performance": float, "weight": float}
_WEIGHT = {"phase": str, "scene": [str], "decisions": int, "chosen": int, "reached": int, **_WEIGHING}
_WEIGHT_MORE = {"rules": {str: int}, "dropped": bool, "cut": int}
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


def explanation_document(registry: Registry, run: RunRecord) -> dict[str, Any]:
    """The fields that `explain --json` promises, and the scores of the two traced episodes.

    `program` and `sources` are programs as `show` gives them; `program` is null if the run stored no policy.

    Raises:
        IntegrityError: If a file of the run isn't what a run writes.
    """
    mapping = registry.read_document(run.id, "mapping")
    weights = registry.read_rows(run.id, "weights")
    trace = registry.read_document(run.id, "trace") or {}
    _check(run.id, mapping, weights, trace)
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
        "trace": [{"phase": phase, **decision} for phase in PHASES for decision in trace.get(phase, ())],
        "trace_scores": {phase: trace.get(f"score_{phase}") for phase in PHASES},
    }


def _check(run: str, mapping: Any, weights: Any, trace: Any) -> None:
    """Stored files are checked before anything leans on their fields."""
    if mapping is not None:
        _demand(run, "mapping.json", [mapping], _MAPPING)
        _demand(run, "mapping.json", mapping["scenes"], _SCENE)
        for scene in mapping["scenes"]:
            _demand(run, "mapping.json", scene["matches"], _MATCH)
    _demand(run, "weights.jsonl", weights, _WEIGHT, _WEIGHT_MORE)
    _demand(run, "trace.json", [trace], {})
    for phase in PHASES:
        _demand(run, "trace.json", [{"score": trace.get(f"score_{phase}", 0.0)}], {"score": float})
        _demand(run, "trace.json", trace.get(phase, []), _DECISION, _DECISION_MORE)
        for decision in trace.get(phase, []):
            _demand(run, "trace.json", decision["weights"], _WEIGHING)


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
        raise IntegrityError(f"{file} of {run} isn't what a run writes", "run that transfer again")


def _is(kind: Any, value: Any) -> bool:
    """Whether a JSON value is of a kind: a type, `[kind]` for a list of them, `{str: kind}` for an object.

    An int is a float too.
    """
    if isinstance(kind, dict):
        return isinstance(value, dict) and all(_is(kind[str], item) for item in value.values())
    if isinstance(kind, list):
        return isinstance(value, list) and all(_is(kind[0], item) for item in value)
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, (int, float) if kind is float else kind)
