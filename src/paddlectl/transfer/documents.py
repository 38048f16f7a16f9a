"""Ψ as a JSON-able document: what `similarity --json` prints and what a run keeps as mapping.json."""

from collections.abc import Mapping, Sequence
from typing import Any

from paddlectl.logic.clauses import Body, Scene
from paddlectl.transfer.similarity import SceneMapping, SceneMatch


def body_document(body: Body) -> list[str]:
    """The literals of a body as texts, sorted by atom."""
    return [str(literal) for literal in sorted(body)]


def mapping_document(
    target: str,
    scenes: Sequence[Scene],
    mapping: SceneMapping,
    sources: Mapping[str, str],
    body_weight: float,
    head_weight: float,
) -> dict[str, Any]:
    """Ψ of a target in the fields that the command line promises.

    Args:
        target: The target's name.
        scenes: Its scenes, in the order to keep.
        mapping: Ψ of those scenes.
        sources: Policy id -> the task that it solves, in the order to keep.
        body_weight: γ_body.
        head_weight: γ_head.
    """
    return {
        "target": target,
        "body_weight": body_weight,
        "head_weight": head_weight,
        "sources": list(sources),
        "scenes": [
            {
                "body": body_document(scene.body),
                "heads": [str(head) for head in sorted(scene.heads)],
                "self_similarity": mapping.self_similarity(scene.body),
                "matches": [_match(match, sources) for match in mapping.rows[scene.body]],
            }
            for scene in scenes
        ],
    }


def _match(match: SceneMatch, sources: Mapping[str, str]) -> dict[str, Any]:
    return {
        "policy": match.policy,
        "task": sources[match.policy],
        "similarity": match.similarity,
        "scenes": [body_document(scene.body) for scene in match.scenes],
    }
