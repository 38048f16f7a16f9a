"""Logic similarity ψ and the scene mapping Ψ (Algorithm 1)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from paddlectl.logic.clauses import Body, Scene

BODY_WEIGHT = 0.8
HEAD_WEIGHT = 0.2


@dataclass(frozen=True, slots=True)
class SceneMatch:
    """What one source has for one target scene.

    Attributes:
        policy: The source, by its key in `map_scenes`.
        similarity: The largest ψ among its scenes; 0 if it has none.
        scenes: Every scene that attains it, in the source's order; all of them if none shares anything.
    """

    policy: str
    similarity: float
    scenes: tuple[Scene, ...]


@dataclass(frozen=True)
class SceneMapping:
    """Ψ: for each target scene, by its body, one match a source, in the order of both."""

    rows: Mapping[Body, tuple[SceneMatch, ...]]

    def self_similarity(self, body: Body) -> float:
        """ψ of a target scene with itself: the largest among its sources; 0 without sources (section 3.2).

        Raises:
            KeyError: If the target has no such scene.
        """
        return max((match.similarity for match in self.rows[body]), default=0.0)

    def overall(self, policy: str) -> float:
        """The mean of a source's ψ over the target's scenes: how similar it is to the whole target."""
        found = [m.similarity for row in self.rows.values() for m in row if m.policy == policy]
        return sum(found) / max(1, len(found))


class _Scale(NamedTuple):
    """ψ of one target scene in whole numbers, so that ties are exact: ψ = (body·b + head·h) / whole.

    b and h count the shared literals and heads.
    """

    body: int
    head: int
    whole: int

    def units(self, target: Scene, source: Scene) -> int:
        return self.body * len(target.body & source.body) + self.head * len(target.heads & source.heads)


def similarity(
    target: Scene, source: Scene, body_weight: float = BODY_WEIGHT, head_weight: float = HEAD_WEIGHT
) -> float:
    """ψ = body_weight·|body_T ∩ body_S| / |body_T| + head_weight·|heads_T ∩ heads_S| / |heads_T|.

    Algorithm 1, line 12. Shared literals have the same atom and the same sign; shared heads are those of the
    scenes' clauses. It isn't symmetric: both shares are of the target. An empty target body (or empty heads)
    has nothing to share, so its term is 0, even against an empty one.

    Returns:
        A value in [0, body_weight + head_weight].

    Raises:
        ValueError: If a weight is negative or not finite.
    """
    scale = _scale(target, body_weight, head_weight)
    return scale.units(target, source) / scale.whole


def similarity_table(target: Scene, body_weight: float, head_weight: float) -> list[list[float]]:
    """ψ of the target with any scene, by how many literals (rows) and heads (columns) the two share.

    Raises:
        ValueError: If a weight is negative or not finite.
    """
    scale = _scale(target, body_weight, head_weight)
    return [
        [(scale.body * literals + scale.head * heads) / scale.whole for heads in range(len(target.heads) + 1)]
        for literals in range(len(target.body) + 1)
    ]


def map_scenes(
    target: Sequence[Scene],
    sources: Mapping[str, Sequence[Scene]],
    body_weight: float = BODY_WEIGHT,
    head_weight: float = HEAD_WEIGHT,
) -> SceneMapping:
    """Ψ by Algorithm 1, lines 8-22: for each target scene and source, the most similar source scenes.

    The printed algorithm adds a new best twice; here the tied scenes are a set. Sources with identical
    programs are matched once.

    Raises:
        ValueError: If two target scenes share a body, or a weight is negative or not finite.
    """
    if len({scene.body for scene in target}) != len(target):
        raise ValueError("two target scenes share a body; group clauses with scenes_of")
    places: dict[tuple[Scene, ...], int] = {}
    place_of = {name: places.setdefault(tuple(scenes), len(places)) for name, scenes in sources.items()}
    rows: dict[Body, tuple[SceneMatch, ...]] = {}
    for scene in target:
        scale = _scale(scene, body_weight, head_weight)
        best = [_best_scenes(scene, program, scale) for program in places]
        rows[scene.body] = tuple(SceneMatch(name, *best[place]) for name, place in place_of.items())
    return SceneMapping(rows)


def _best_scenes(target: Scene, program: tuple[Scene, ...], scale: _Scale) -> tuple[float, tuple[Scene, ...]]:
    """The largest ψ in one source, and every scene that attains it (Algorithm 1, lines 10-19)."""
    units = [scale.units(target, scene) for scene in program]
    most = max(units, default=0)
    tied = tuple(scene for scene, found in zip(program, units, strict=True) if found == most)
    return most / scale.whole, tied


def _scale(target: Scene, body_weight: float, head_weight: float) -> _Scale:
    body = _as_written(body_weight) / max(1, len(target.body))
    head = _as_written(head_weight) / max(1, len(target.heads))
    whole = math.lcm(body.denominator, head.denominator)
    return _Scale(int(body * whole), int(head * whole), whole)


def _as_written(weight: float) -> Fraction:
    """0.8 as 4/5 and not its nearest binary fraction: only so do 0.8·3/4 and 0.8·1/2 + 0.2 tie."""
    if not (math.isfinite(weight) and weight >= 0):
        raise ValueError(f"a weight must be finite and not negative: {weight}")
    return Fraction(repr(float(weight)))
