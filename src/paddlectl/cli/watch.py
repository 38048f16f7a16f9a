"""`paddlectl watch`."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import (
    AsJson,
    Held,
    RegistryPlace,
    TaskFiles,
    complete_tasks,
    file_at,
    whole_number,
)
from paddlectl.cli.output_files import require_output, write_output
from paddlectl.errors import UsageError
from paddlectl.registry.fields import SEEDS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from paddlectl.experiments.watching import Seen

EXAMPLE = "Example: paddlectl watch BoxDoor --gif boxdoor.gif"
WIDEST = 90  # columns
MOST = 400  # pictures of a GIF


def watch(
    policy: Held,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="TASK",
            autocompletion=complete_tasks,
            help="Another task of the same domain; without: the policy's own.",
            show_default=False,
        ),
    ] = None,
    gif: Annotated[
        Path | None,
        typer.Option(
            parser=file_at,
            metavar="FILE",
            help="Write a moving picture there instead of playing in the terminal.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(parser=whole_number(0, SEEDS - 1), metavar="N", help="Decides the layout.")
    ] = 0,
    per_second: Annotated[
        int, typer.Option(parser=whole_number(1, 50), metavar="N", help="Pictures in a second.")
    ] = 6,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Watch an episode of a policy on an unseen layout, with its subgoals; or make a GIF of it."""
    from paddlectl.cli.named import learned, task_named
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import clean, print_json, print_text
    from paddlectl.tasks.suite import load

    if gif is None and (as_json or not sys.stdout.isatty()):
        raise UsageError("an episode is played in a terminal", "or written to a file: --gif FILE")
    if gif is not None:
        require_output(gif, ".gif")
    other = task_named(task) if task is not None else None
    opened = Registry.open(registry, create=False)
    record = learned(opened, policy)
    with stdout_kept():
        from paddlectl.experiments.policies import require_domain, revive, task_of
        from paddlectl.experiments.watching import watched

        asked = other or task_of(record)
        played = load(asked)
        require_domain(record, played)
        seen = watched(revive(opened, record), asked, seed)
        moments = thinned(seen, MOST) if gif else []
    if gif is None:
        _show(seen, per_second)
        return
    _write(gif, moments, per_second)
    end = moments[-1]
    if as_json:
        told = {"policy": record.id, "task": played.name, "seed": seed, "steps": end.t, "score": end.score}
        print_json({**told, "file": str(gif)})
    else:
        print_text([clean(f"{gif}: {played.name} by {record.id}, {_end(end)}")])


def _show(seen: "Iterable[Seen]", per_second: float) -> None:
    from paddlectl.report.frames import blocks
    from paddlectl.report.output import LivePictures, width

    columns = min(WIDEST, width())
    with LivePictures() as live:
        for moment in seen:
            picture = blocks(moment.picture, columns, live.encoding)
            live.show(picture, _caption(moment))
            time.sleep(1 / per_second)


def thinned(seen: "Iterable[Seen]", most: int) -> "list[Seen]":
    """At most so many moments at equal distances, and the last; no more are ever kept."""
    kept: list[Seen] = []
    every, moment = 1, None
    for number, moment in enumerate(seen):
        if number % every == 0:
            kept.append(moment)
        if len(kept) == most:
            kept, every = kept[::2], 2 * every
    return kept if moment is None or kept[-1] is moment else [*kept, moment]


def _write(path: Path, moments: "list[Seen]", per_second: float) -> None:
    from paddlectl.report.frames import gif

    data = gif([moment.picture for moment in moments], [_caption(moment) for moment in moments], per_second)
    write_output(path, data)


def _caption(moment: "Seen") -> str:
    return f"{moment.t:>4}  {_end(moment) if moment.ended else moment.subgoal}"


def _end(moment: "Seen") -> str:
    solved = f"solved, score {moment.score:.2f}" if moment.score > 0 else "not solved"
    return f"{solved}, {moment.t} steps"
