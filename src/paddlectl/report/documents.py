"""Records of the registry as the JSON-able documents that the command line promises."""

from collections.abc import Iterable
from typing import Any

from paddlectl.registry.records import PolicyRecord, RunRecord


def policy_row(policy: PolicyRecord) -> dict[str, Any]:
    return {
        "policy": policy.id,
        "task": policy.task,
        "domain": policy.domain,
        "method": policy.method,
        "seed": policy.seed,
        "frames": policy.frames,
        "success_rate": policy.success_rate,
        "mean_score": policy.mean_score,
        "mean_length": policy.mean_length,
        "crispness": policy.crispness,
        "run": policy.run,
        "created": policy.created,
    }


def run_row(run: RunRecord) -> dict[str, Any]:
    return {
        "run": run.id,
        "name": run.name,
        "tags": list(run.tags),
        "kind": run.kind,
        "method": run.method,
        "task": run.task,
        "scenario": run.scenario,
        "sources": list(run.sources),
        "seed": run.seed,
        "status": run.status,
        "frames": run.frames,
        "episodes": run.episodes,
        "seconds": run.seconds,
        "success_rate": run.results.get("success_rate"),
        "results": run.results,
        "policy": run.policy,
        "created": run.created,
        "finished": run.finished,
    }


def policies_document(policies: Iterable[PolicyRecord], total: int) -> dict[str, Any]:
    """Rows of policies, of so many that there are in all."""
    return {"policies": [policy_row(policy) for policy in policies], "total": total}


def runs_document(runs: Iterable[RunRecord], total: int) -> dict[str, Any]:
    """Rows of runs, of so many that there are in all."""
    return {"runs": [run_row(run) for run in runs], "total": total}
