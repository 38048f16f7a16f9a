"""Why a transfer acted as it did, as one document made from what the run left; nothing is computed again."""

from collections.abc import Iterable, Mapping
from typing import Any

from paddlectl.errors import IntegrityError
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.programs import program_document

TARGET = "target"
PHASES = ("early", "late")

_MAPPING = ("target", "sources", "scenes")
_SCENE = ("body", "heads", "self_similarity", "matches")
_MATCH = ("policy", "task", "similarity", "scenes")
_WEIGHT = (
    "phase",
    "scene",
    "policy",
    "similarity",
    "performance",
    "weight",
    "decisions",
    "chosen",
    "reached",
)
_DECISION = ("step", "scene", "clause", "guide", "weights", "head", "steps", "reached")
_CANDIDATE = ("policy", "similarity", "performance", "weight")


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
        "source_programs": [program_document(registry.policy(source)) for source in run.sources],
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
    _demand(run, "weights.jsonl", weights, _WEIGHT)
    _demand(run, "trace.json", [trace], ())
    for phase in PHASES:
        _demand(run, "trace.json", trace.get(phase, []), _DECISION)
        for decision in trace.get(phase, []):
            _demand(run, "trace.json", decision["weights"], _CANDIDATE)


def _demand(run: str, file: str, rows: Any, fields: Iterable[str]) -> None:
    sound = isinstance(rows, list) and all(
        isinstance(row, Mapping) and all(field in row for field in fields) for row in rows
    )
    if not sound:
        raise IntegrityError(f"{file} of {run} isn't what a run writes", "run that transfer again")
