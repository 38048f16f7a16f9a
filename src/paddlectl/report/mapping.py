"""Ψ for people: scenes by the facts that hold in them; for each source its ψ and its best scenes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import RenderableType

from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.grid import Grid, Head, Row
from paddlectl.report.output import clean
from paddlectl.report.sparkline import BLOCKS

MOST_SOURCES = 12
SHOWN_SCENES = 2  # of one source that tie for one target scene


def scene_text(literals: Iterable[str]) -> str:
    """A full body by the facts that hold in it, `{has_key(env), is_blocked(door)}`."""
    return clean("{" + ", ".join(literal for literal in literals if not literal.startswith("!")) + "}")


def facts_of(bodies: Iterable[Sequence[str]]) -> list[str]:
    """Every atom that the bodies speak of, in alphabetical order."""
    return sorted({literal.removeprefix("!") for body in bodies for literal in body})


def legend(bodies: Iterable[Sequence[str]]) -> str:
    """How scenes are written, so that the short form can't be misread."""
    return clean(
        f"A scene is written by the facts that hold in it; all others of {', '.join(facts_of(bodies))} don't."
    )


class Labels:
    """Short names for policies: their task, with the id where two solve the same one."""

    def __init__(self, tasks: Mapping[str, str]) -> None:
        self._tasks = tasks

    def task(self, policy: str) -> str | None:
        """What a policy has learned, if that is known."""
        return self._tasks.get(policy)

    def __call__(self, policy: str) -> str:
        task = self.task(policy)
        if task is None:
            return clean(policy)
        alike = sum(other == task for other in self._tasks.values()) > 1
        return clean(f"{task} ({policy})" if alike else task)


def labels_for(explanation: Mapping[str, Any]) -> Labels:
    """Those of a run's sources; of an imported run's, their ids elsewhere."""
    elsewhere = {_there(source): source for source in explanation["sources"] if source.startswith(ELSEWHERE)}
    here = {program["policy"]: program["task"] for program in explanation["source_programs"]}
    mapped = _tasks_of(explanation["mapping"]) if explanation["mapping"] else {}
    return Labels({**elsewhere, **here, **mapped})


def labels_of(registry: Registry, run: RunRecord) -> Labels:
    """The same without an explanation."""
    here = {
        source: registry.policy(source).task for source in run.sources if not source.startswith(ELSEWHERE)
    }
    there = {_there(source): source for source in run.sources if source not in here}
    return Labels(here | there)


def source_text(source: str, labels: Labels) -> str:
    """A run's source by its task, if that is known, and its id."""
    task = labels.task(_there(source))
    return clean(source if task in (None, source) else f"{task} ({source})")


def sources_text(sources: Sequence[str], labels: Labels) -> str:
    """A line with a run's sources; of very many with the first."""
    told = [source_text(source, labels) for source in sources[:MOST_SOURCES]]
    more = len(sources) - len(told)
    return f"sources: {', '.join(told) or 'none'}{f' and {more} more; --json has all' if more else ''}"


def _there(source: str) -> str:
    """A source's id as its run knows it."""
    return source.removeprefix(ELSEWHERE)


def _tasks_of(document: Mapping[str, Any]) -> dict[str, str]:
    """The task of each source of Ψ."""
    matches = (match for scene in document["scenes"] for match in scene["matches"])
    return {match["policy"]: match["task"] for match in matches}


def mapping_parts(document: Mapping[str, Any]) -> list[RenderableType]:
    """All of Ψ."""
    labels = Labels(_tasks_of(document))
    sources = ", ".join(f"{labels(policy)} ({clean(policy)})" for policy in document["sources"])
    return [
        f"Ψ of {clean(document['target'])} from {sources}",
        f"ψ = {document['body_weight']:g} · share of equal literals"
        f" + {document['head_weight']:g} · share of equal heads",
        legend(_bodies(document["scenes"])),
        mapping_table(document["scenes"], labels),
    ]


def heat_map_parts(document: Mapping[str, Any]) -> list[RenderableType]:
    """ψ of each scene with each source, a column each."""
    heads = [Head("target scene", breaks=True)]
    heads += [Head(clean(policy), right=True) for policy in document["sources"]]
    rows = []
    for scene in document["scenes"]:
        found = [match["similarity"] for match in scene["matches"]]
        best = scene["self_similarity"]
        rows.append(Row((scene_text(scene["body"]), *(_warm(each, each == best) for each in found))))
    return [
        f"ψ of each scene of {clean(document['target'])} with the best scene of each; * is the largest",
        legend(_bodies(document["scenes"])),
        Grid(heads, rows),
    ]


def _warm(similarity: float, best: bool) -> str:
    """`▅ 0.56*`."""
    level = BLOCKS[round(min(1.0, similarity) * (len(BLOCKS) - 1))]
    return f"{level} {similarity:.2f}{'*' if best else ' '}"


def _bodies(scenes: Iterable[Mapping[str, Any]]) -> Iterable[Sequence[str]]:
    for scene in scenes:
        yield scene["body"]
        for match in scene["matches"]:
            yield from match["scenes"]


def mapping_table(scenes: Iterable[Mapping[str, Any]], labels: Labels) -> Grid:
    """One row for each target scene and source; the best source of a scene in bold with a star."""
    rows: list[Row | None] = []
    for scene in scenes:
        shown = scene_text(scene["body"])
        for match in scene["matches"]:
            best = match["similarity"] == scene["self_similarity"]
            name = labels(match["policy"]) + (" *" if best else "")
            cells = (shown, name, f"{match['similarity']:.3f}", _scenes(match["scenes"]))
            rows.append(Row(cells, "bold" if best else ""))
            shown = ""
        rows.append(None)
    return Grid(_HEADS, rows)


_HEADS = (
    Head("target scene", breaks=True),
    Head("source"),
    Head("ψ", right=True),
    Head("its most similar scenes", breaks=True),
)


def _scenes(bodies: Sequence[Sequence[str]]) -> str:
    more = len(bodies) - SHOWN_SCENES
    return "\n".join(map(scene_text, bodies[:SHOWN_SCENES])) + (f"\nand {more} more" if more > 0 else "")
