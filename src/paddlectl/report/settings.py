"""By which numbers a run learned: all of them as a document, and for people those that are unusual."""

from collections.abc import Mapping
from typing import Any

from rich.console import RenderableType

from paddlectl.registry.records import RunRecord
from paddlectl.report.definitions import definition_lines
from paddlectl.report.documents import run_row
from paddlectl.report.mapping import Labels, sources_text
from paddlectl.report.output import clean
from paddlectl.report.tables import UNUSUAL, figures_text, table


def numbers(run: RunRecord) -> dict[str, Any]:
    """`{settings, rules, unusual: [{name, value, usual}], definition}`; None for what a run doesn't tell."""
    told = run.settings
    own = {"settings": told.get("learning", told.get("hybrid")), "rules": told.get("rules")}
    definition = run.content.definition
    usual = told.get("unusual")
    if not isinstance(usual, Mapping):
        return {**own, "unusual": None, "definition": definition}
    return {
        **own,
        "definition": definition,
        "unusual": [{"name": name, "value": _at(name, own), "usual": value} for name, value in usual.items()],
    }


def _at(name: str, own: Mapping[str, Any]) -> Any:
    first, *rest = name.split(".")
    value, names = (own["rules"], rest) if first == "rules" else (own["settings"], [first, *rest])
    for each in names:
        value = value.get(each) if isinstance(value, Mapping) else None
    return value


def numbers_parts(document: Mapping[str, Any], method: str) -> list[RenderableType]:
    """The unusual ones, if there are any, and what the task's file said, if it is from one."""
    title = f"Numbers that differ from the usual ones of {clean(method)}"
    parts: list[RenderableType] = []
    if document["unusual"]:
        parts += ["", table(UNUSUAL, document["unusual"], title)]
    if document["definition"]:
        parts += ["", "Its task, as a file tells it:", *definition_lines(document["definition"])]
    return parts


def run_document(run: RunRecord) -> dict[str, Any]:
    """A run with the budget that it was given, and its numbers."""
    return {**run_row(run), "budget": run.settings.get("frames"), **numbers(run)}


def run_parts(document: Mapping[str, Any], labels: Labels) -> list[RenderableType]:
    """What a run was, how it went, what it reused, and what was unusual in it."""
    seed, budget = document["seed"], document["budget"]
    of = f" of {budget:,}" if isinstance(budget, int) else ""
    what = f"{document['method']} on {document['task']}"
    parts: list[RenderableType] = [
        clean(f"{document['run']}: {what}, seed {seed}, {document['status']}"),
        clean(f"{document['frames']:,}{of} frames, {document['episodes']:,} episodes"),
    ]
    if document["name"]:
        parts.append(clean(f"name: {document['name']}"))
    if document["tags"]:
        parts.append(clean(f"tags: {', '.join(document['tags'])}"))
    if document["scenario"]:
        parts.append(clean(f"scenario {document['scenario']}"))
    if document["sources"]:
        parts.append(sources_text(document["sources"], labels))
    if document["policy"]:
        parts.append(clean(f"policy: {document['policy']}"))
    if told := figures_text(document["results"]):
        parts.append(told)
    if document["unusual"] == []:
        parts.append(clean(f"Its numbers are the usual ones of {document['method']}."))
    return [*parts, *numbers_parts(document, document["method"])]
