"""`paddlectl runs`."""

import re
import sys
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import (
    AsJson,
    EveryRow,
    MostRows,
    OfMethod,
    OfTask,
    RegistryPlace,
    asked_for,
    complete_compared,
    most_rows,
    note_unknown,
)
from paddlectl.errors import UsageError
from paddlectl.registry.names import nearest, shown
from paddlectl.registry.records import RUN_STATES

if TYPE_CHECKING:
    from paddlectl.registry.store import Registry

EXAMPLE = "Example: paddlectl runs --status finished --since 2d"
LOOKED_AT = 1000  # newest runs whose tags and scenarios may have been meant
SECONDS = 2.0  # between two looks
UNITS = {"d": "days", "h": "hours", "m": "minutes"}


def status_of(text: str) -> str:
    """One of the states of a run.

    Raises:
        UsageError: If it is none.
    """
    if text in RUN_STATES:
        return text
    near = nearest(text, RUN_STATES)
    raise UsageError(f"{shown(text)} is no status of a run", f"{near}use one of {', '.join(RUN_STATES)}")


def moment_of(text: str) -> str:
    """A moment in UTC, as the registry writes them: `2d`, `12h` or `30m` ago, or a date with or without time.

    Raises:
        UsageError: If it is neither.
    """
    ago = re.fullmatch(r"([0-9]{1,6})([dhm])", text)
    try:
        if ago:
            moment = datetime.now(UTC) - timedelta(**{UNITS[ago[2]]: int(ago[1])})
        else:
            moment = datetime.fromisoformat(text).astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise UsageError(f"{shown(text)} is no date", "use 2d, 12h, 30m or 2026-03-31") from error
    return moment.isoformat(timespec="milliseconds")


def runs(
    status: Annotated[
        str | None,
        typer.Option(
            "--status",
            parser=status_of,
            metavar="STATUS",
            autocompletion=lambda: list(RUN_STATES),
            help="Running, finished, interrupted or failed ones.",
            show_default=False,
        ),
    ] = None,
    task: OfTask = None,
    method: OfMethod = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            metavar="NAME",
            autocompletion=complete_compared,
            help="Transfers of the scenario of this name.",
            show_default=False,
        ),
    ] = None,
    tag: Annotated[
        str | None, typer.Option("--tag", metavar="TAG", help="With this tag.", show_default=False)
    ] = None,
    since: Annotated[
        str | None,
        typer.Option(
            "--since",
            parser=moment_of,
            metavar="WHEN",
            help="Begun since: 2d, 12h, 30m ago; or a date, 2026-03-31 or 2026-03-31T10:30.",
            show_default=False,
        ),
    ] = None,
    watch: Annotated[bool, typer.Option("--watch", help="Look again every two seconds, until ^C.")] = False,
    every: EveryRow = False,
    limit: MostRows = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """List the runs in the registry, newest first."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import runs_document
    from paddlectl.report.output import print_json, print_live, print_text
    from paddlectl.report.tables import RUNS, listed

    most = most_rows(every, limit)
    wanted = asked_for(status=status, task=task, method=method, scenario=scenario, tag=tag)
    if watch and (as_json or not sys.stdout.isatty()):
        raise UsageError("--watch needs a terminal", "leave it out")
    opened = Registry.open(registry, create=False)

    def document() -> dict[str, Any]:
        found, total = opened.newest_runs(most, wanted, since or "")
        return runs_document([*map(opened.so_far, found)], total)

    def told(found: dict[str, Any]) -> list[Any]:
        return listed(RUNS, found["runs"], found["total"])

    if watch:
        print_live(lambda: told(document()), SECONDS)
        return
    found = document()
    if not found["runs"]:
        note_unknown(wanted)
        _note_none(opened, wanted)
    if as_json:
        print_json(found)
    else:
        print_text(told(found))


def _note_none(registry: "Registry", wanted: dict[str, str]) -> None:
    """Says of a list that came out empty if no run at all has the tag, or is of the scenario."""
    from paddlectl.cli.texts import one_line

    newest, _ = registry.newest_runs(LOOKED_AT)
    known = {
        "tag": [tag for run in newest for tag in run.tags],
        "scenario": [run.scenario for run in newest if run.scenario],
    }
    for noun, others in known.items():
        name = wanted.get(noun)
        if name is not None and not registry.newest_runs(1, {noun: name})[1]:
            near = nearest(name, others).removesuffix(" or ")
            print(
                one_line(f"note: no run has the {noun} {shown(name)}{near and f'; {near}'}"), file=sys.stderr
            )
