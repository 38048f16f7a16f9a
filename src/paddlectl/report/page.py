"""An explanation as a page: what `explain` tells, with pictures. It needs no network, and no scripts."""

import base64
import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from itertools import groupby
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.experiments.curves import LearningCurve, in_order
from paddlectl.experiments.log import ended_episodes
from paddlectl.experiments.policies import needs_of
from paddlectl.experiments.similar import stored_program
from paddlectl.logic.prolog import format_prolog
from paddlectl.methods.catalogue import METHODS
from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.explained import SHORTEST, WHY
from paddlectl.report.explanation import PHASES, TARGET, recordings_of
from paddlectl.report.film import COLUMNS, PER_SECOND, Film, film
from paddlectl.report.followed import value_lines, words
from paddlectl.report.mapping import Labels, labels_for, scene_text
from paddlectl.report.output import clean
from paddlectl.report.settings import numbers
from paddlectl.report.summary import context_text, floor_text, header_parts, short_text, verdict
from paddlectl.report.svg import COLOURS, Line, lines, stacked
from paddlectl.report.tables import figures_of, percent
from paddlectl.studies.verdicts import ALIKE

MOST_SCENES = 8
"""Panels of who led over training."""
PARTS = 25
"""Of a run, in each of which the shares are counted."""
MOST_PARTS = 150
"""Rows of an episode without decisions."""
MOST_GOALS = 12
"""Subgoals of an episode that are told to whom can't see it."""
CURVE_SIZE, PANEL_SIZE = (560, 220), (340, 150)

Document = Mapping[str, Any]
Context = tuple[str, ...]


def explanation_page(registry: Registry, run: RunRecord, document: Document) -> str:
    """The page.

    Args:
        registry: Where the run is.
        run: The run.
        document: Its `explanation_document`; recordings are read here, for the rest is told without them.
    """
    environment = Environment(
        loader=PackageLoader("paddlectl.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    labels = labels_for(document)
    script = resources.files("paddlectl.report").joinpath("templates/page.js").read_text(encoding="utf-8")
    title, sources, _, *way = map(str, header_parts(run, labels))
    colours = _colours(document)
    html = environment.get_template("page.html.j2").render(
        title=title,
        summary=_summary(run),
        sources=sources,
        way="".join(way),
        figures=figures_of(run.results),
        verdict=" ".join(map(str, verdict(document, labels))).strip(),
        curve=_curve(registry, run),
        terms=floor_text(run).strip() if document["weights"] else "",
        short=short_text(document["final_episodes"]),
        legend=[*_legend(colours, labels)],
        leaders=[*_leaders(document, colours)],
        psi=_psi(document, labels),
        program=_program(registry, run, document),
        documents=[
            (words(name), value_lines(told, labels), _json(told))
            for name, told in document["documents"].items()
        ],
        episodes=[*_episodes(registry, run, document, colours)],
        script=script,
        script_hash=f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}",
        unusual=numbers(run)["unusual"],
        settings=_json(run.settings),
        versions=sorted(run.versions.items()),
    )
    return re.sub(r"(?<=\d) %", "\N{NO-BREAK SPACE}%", html)


def _summary(run: RunRecord) -> str:
    """What its task is; nothing where that isn't there."""
    try:
        task, _ = needs_of(run)
    except PaddlectlError:
        return ""
    return clean(f"{task.name}: {task.summary}") if task.summary else ""


def _json(value: Any) -> str:
    return clean_lines(json.dumps(value, indent=1, ensure_ascii=False))


def clean_lines(text: str) -> str:
    """Every line without control characters."""
    return "\n".join(map(clean, text.split("\n")))


def _name(policy: str, labels: Labels) -> str:
    return "the target" if policy == TARGET else labels(policy)


def _colours(document: Document) -> dict[str, int]:
    """Policy -> its colour, the target's first. Of very many those that led most have one of their own."""
    sources = [source.removeprefix(ELSEWHERE) for source in document["sources"]]
    led = sum((each for scene in _counts(document).values() for each in scene.values()), Counter[str]())
    first = (
        sources if len(sources) < COLOURS else sorted(sources, key=lambda source: -led[source])[: COLOURS - 2]
    )
    own = {policy: number for number, policy in enumerate((TARGET, *first))}
    return own | {source: COLOURS - 1 for source in sources if source not in own}


def _legend(colours: Mapping[str, int], labels: Labels) -> Iterator[tuple[str, int]]:
    named = [(policy, colour) for policy, colour in colours.items()]
    alike = Counter(colours.values())
    yield from ((_name(policy, labels), colour) for policy, colour in named if alike[colour] == 1)
    yield from ((f"{count} other sources", colour) for colour, count in alike.items() if count > 1)


# Curves


def _curve(registry: Registry, run: RunRecord) -> dict[str, Any] | None:
    """The score of the run, beside that of one from scratch if there is one; None without episodes."""
    own = _line(registry, run, run.method, 0)
    if own is None:
        return None
    chart, note, longest = [own], "", max(run.frames, own.x[-1])
    scratch = next(_from_scratch(registry, run), None)
    beside = scratch and _line(registry, scratch, f"{scratch.method} from scratch ({scratch.id})", 1)
    if beside:
        chart.append(beside.until(longest))
    if scratch and scratch.frames > ALIKE * longest:
        note = f"{scratch.id} went on to frame {scratch.frames:,}."
    legend = [(clean(line.name), line.colour) for line in chart]
    return {"chart": lines(chart, longest, CURVE_SIZE), "legend": legend, "note": note}


def _line(registry: Registry, run: RunRecord, name: str, colour: int) -> Line | None:
    episodes = in_order(ended_episodes(registry, run.id))
    if not episodes:
        return None
    frames = max(run.frames, *(episode.finished for episode in episodes))
    scores = LearningCurve(episodes, frames).by_frames()
    return Line(name, colour, [frames * n / len(scores) for n in range(len(scores))], scores)


def _from_scratch(registry: Registry, run: RunRecord) -> Iterator[RunRecord]:
    """Finished runs of the task that reused nothing: by its base learner, of its seed, the newest first."""
    if not run.sources:
        return
    teaches = METHODS[run.method].teaches if run.method in METHODS else ()
    found, _ = registry.newest_runs(200, {"task": run.task, "status": "finished"})
    alone = [other for other in found if not other.sources and other.id != run.id and other.frames]
    alone = [other for other in alone if other.content.identity == run.content.identity]
    yield from sorted(alone, key=lambda other: (other.method not in teaches, other.seed != run.seed))


# Who led


def _leaders(document: Document, colours: Mapping[str, int]) -> Iterator[tuple[str, str]]:
    """For each of the most frequent scenes its text, and the shares of who led there over training."""
    counts = _counts(document)
    last = max((frames for scene in counts.values() for frames in scene), default=0)
    frequent = sorted(counts, key=lambda scene: -sum(each.total() for each in counts[scene].values()))
    for scene in frequent[:MOST_SCENES]:
        parts = _parts(counts[scene], last)
        ends = [last * (part + 1) / len(parts) for part in range(len(parts))]
        shares: dict[int, list[float]] = {}
        for policy, colour in colours.items():
            own = [part[policy] / part.total() if part.total() else 0.0 for part in parts]
            shares[colour] = [
                sum(both) for both in zip(own, shares.get(colour, [0.0] * len(own)), strict=True)
            ]
        text = context_text(scene)
        yield text, stacked(shares, ends, PANEL_SIZE, f"who led in {text}, share over training")


def _counts(document: Document) -> dict[Context, dict[int, Counter[str]]]:
    """Scene -> until which frame -> how often each led since the last."""
    bodies = [tuple(scene["body"]) for scene in (document["mapping"] or {"scenes": ()})["scenes"]]
    rows = [
        (bodies[row["scene"]], row["frames"], row["policy"], row["chosen"])
        for row in document["moments"]
        if row["scene"] < len(bodies)
    ] or [(tuple(row["context"]), row["frames"], row["source"], row["chosen"]) for row in document["reuse"]]
    counts: dict[Context, dict[int, Counter[str]]] = {}
    for scene, frames, policy, chosen in rows:
        counts.setdefault(scene, {}).setdefault(frames, Counter())[policy] += chosen
    return counts


def _parts(counts: Mapping[int, Counter[str]], last: int) -> list[Counter[str]]:
    """The counts in equal parts of the run; where nothing was recorded, those of the part before or next."""
    number = min(PARTS, max(2, len(counts)))
    parts = [Counter[str]() for _ in range(number)]
    for frames, led in counts.items():
        parts[min(number - 1, frames * number // (last + 1))].update(led)
    known = [part for part in parts if part.total()]
    for number, part in enumerate(parts):
        if not part.total():
            parts[number] = parts[number - 1] if number else known[0]
    return parts


# Ψ, the program, episodes


def _psi(document: Document, labels: Labels) -> dict[str, Any] | None:
    """Sources, and for each scene that was met its ψ with each of them."""
    mapping = document["mapping"]
    if not mapping or not mapping["sources"]:
        return None
    met = {tuple(row["scene"]) for row in document["weights"] if row["decisions"]}
    rows = []
    for scene in mapping["scenes"]:
        if met and tuple(scene["body"]) not in met:
            continue
        found = {match["policy"]: match for match in scene["matches"]}
        cells = [found.get(source) for source in mapping["sources"]]
        rows.append(
            {
                "scene": scene_text(scene["body"]),
                "cells": [
                    cell
                    and {
                        "value": cell["similarity"],
                        "best": cell["similarity"] == scene["self_similarity"],
                        "scenes": [*map(scene_text, cell["scenes"])],
                    }
                    for cell in cells
                ],
            }
        )
    return {"sources": [*map(labels, mapping["sources"])], "rows": rows}


def _program(registry: Registry, run: RunRecord, document: Document) -> dict[str, Any] | None:
    program = document["program"]
    if not program or not program["clauses"]:
        return None
    scenes: dict[str, list[tuple[float, str]]] = {}
    for clause in program["clauses"]:
        told = (float(clause["probability"]), clean(clause["head"]))
        scenes.setdefault(scene_text(clause["body"]), []).append(told)
    try:
        prolog = format_prolog(stored_program(registry.policy(run.policy or "")))
    except PaddlectlError:
        prolog = ""
    return {
        "scenes": [(scene, sorted(heads, reverse=True)) for scene, heads in scenes.items()],
        "minimised": [*map(clean, program["minimised"][:SHORTEST])] or ["(no clause)"],
        "prolog": prolog,
    }


def _episodes(
    registry: Registry, run: RunRecord, document: Document, colours: Mapping[str, int]
) -> Iterator[dict[str, Any]]:
    labels = labels_for(document)
    recordings, damaged = _recordings(registry, run)
    for phase in PHASES:
        decisions = [decision for decision in document["trace"] if decision["phase"] == phase]
        recording = recordings.get(phase)
        if not decisions and recording is None:
            continue
        shown, note = None, damaged
        if recording is not None:
            try:
                played = film(run, recording, decisions, document["reuse"])
                shown = _film(played, recording, labels, colours)
            except PaddlectlError as error:
                note = f"Without pictures: {clean(error.message)}."
        yield {
            "phase": phase,
            "title": _title(phase, recording, document["trace_scores"][phase], bool(decisions)),
            "note": note,
            "film": shown,
            "rows": [_decision(decision, labels) for decision in decisions],
        }


def _recordings(registry: Registry, run: RunRecord) -> tuple[Document, str]:
    """The episodes that can be played again, or why there are none to be had."""
    try:
        return recordings_of(registry, run), ""
    except IntegrityError as error:
        return {}, f"Without pictures: {clean(error.message)}."


def _title(phase: str, recording: Document | None, score: float | None, traced: bool) -> str:
    title = f"One {phase} episode" + (", decision by decision" if traced else "")
    if recording is not None:
        return f"{title}: {_outcome(recording)}, ended at frame {recording['frames']:,}"
    return title if score is None else f"{title}; score {score:.2f}"


def _outcome(recording: Document) -> str:
    solved = f"solved, score {recording['score']:.2f}" if recording["score"] > 0 else "not solved"
    return f"{solved}, {recording['length']:,} steps"


def _film(shown: Film, recording: Document, labels: Labels, colours: Mapping[str, int]) -> dict[str, Any]:
    """What the page's template tells of a film."""
    parts = [
        {
            "first": part.first,
            "scene": part.scene,
            "subgoal": part.subgoal,
            "leader": part.leader and _name(part.leader, labels),
            "led": "leads" if part.share is None else f"is followed most often here, {percent(part.share)}",
            "share": "" if part.share is None else percent(part.share),
            "colour": _colour(part.leader, colours),
        }
        for part in shown.parts
    ]
    frames, (width, height) = [*shown.frames()], shown.size
    every = shown.steps[1] - shown.steps[0] if len(shown.steps) > 2 else 1
    end = frames[-1]
    goals = [goal for goal, _ in groupby(part.subgoal for part in shown.parts if part.subgoal)]
    return {
        "sheet": shown.sheet,
        "width": width,
        "height": height,
        "columns": COLUMNS,
        "rows": shown.rows,
        "frames": frames,
        "colours": [*(part["colour"] for part in parts), "rule"],
        "still": f"--across: {end.across:.3f}%; --down: {end.down:.3f}%; --step: {end.step}; "
        f"--part: {end.part}; --leads: var(--rule)",
        "each": 1000 // PER_SECOND,
        "lasts": f"{shown.seconds:.1f}",
        "end": f"{(len(frames) - 0.5) / PER_SECOND:.1f}",
        "last": len(frames) - 1,
        "length": f"{shown.steps[-1]:,}",
        "thinned": "" if every == 1 else f"; a picture each {every} steps",
        "outcome": _outcome(recording).capitalize(),
        "alt": f"An episode as moving pictures: {_outcome(recording)}. " + _way(goals),
        "parts": parts,
        "goals": bool(goals),
        "leaders": any(part.leader for part in shown.parts),
        "most": MOST_PARTS,
    }


def _way(goals: Sequence[str]) -> str:
    if not goals:
        return "The table tells what held when."
    more = len(goals) - MOST_GOALS
    return f"It goes for {', then '.join(goals[:MOST_GOALS])}{f' and {more} more' if more > 0 else ''}."


def _colour(policy: str, colours: Mapping[str, int]) -> str:
    return f"c{colours[policy]}" if policy in colours else "rule"


def _decision(decision: Document, labels: Labels) -> dict[str, Any]:
    missed = "cut off by the horizon" if decision.get("cut") else "not reached"
    return {
        "step": decision["step"],
        "scene": scene_text(decision["scene"]),
        "guide": _name(decision["guide"], labels),
        "subgoal": clean(decision["head"]),
        "steps": decision["steps"],
        "end": "reached" if decision["reached"] else missed,
        "why": WHY.get(decision.get("rule", ""), clean(decision.get("rule", ""))),
        "weights": [
            (_name(one["policy"], labels), one["similarity"], one["performance"], one["weight"])
            for one in decision["weights"]
        ],
        "clause": clean(decision["clause"]),
    }
