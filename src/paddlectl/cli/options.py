"""Options and arguments that several commands share, and what the shell completes for them."""

import os
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.fields import MOST_FRAMES, SEEDS

REGISTRY = "PADDLECTL_REGISTRY"
LISTED = 50


def _beginning(pairs: list[tuple[str, str]], incomplete: str) -> list[tuple[str, str]]:
    return [pair for pair in pairs if pair[0].startswith(incomplete)]


def complete_tasks(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import scenario_files, task_names

    names = [*task_names(), *(scenario_files(incomplete) if incomplete else ())]
    return [name for name in names if name.startswith(incomplete)]


def complete_sources(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import source_names

    found = source_names(ctx.params.get("registry"), ctx.params.get("target"), incomplete)
    return _beginning(found, incomplete)


def complete_transfers(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import transfer_names

    return _beginning(transfer_names(ctx.params.get("registry"), incomplete), incomplete)


def complete_held(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import ended_names

    return _beginning(ended_names(ctx.params.get("registry"), incomplete), incomplete)


def complete_runs(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import run_names

    return _beginning(run_names(ctx.params.get("registry"), incomplete), incomplete)


def complete_stopped(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import stopped_names

    return _beginning(stopped_names(ctx.params.get("registry"), incomplete), incomplete)


def complete_compared(ctx: typer.Context, incomplete: str) -> list[str]:
    from paddlectl.cli.completion import compared_names

    return [name for name in compared_names(ctx.params.get("registry")) if name.startswith(incomplete)]


def complete_figures(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import figure_names

    return [name for name in figure_names() if name.startswith(incomplete)]


def complete_results(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import result_files, shipped_studies

    names = [*shipped_studies(), *result_files(incomplete)]
    return [name for name in names if name.startswith(incomplete)]


def complete_scenarios(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import scenario_files, shipped_scenarios

    names = [*shipped_scenarios(), *scenario_files(incomplete)]
    return [name for name in names if name.startswith(incomplete)]


def complete_studies(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import scenario_files, shipped_studies

    names = [*shipped_studies(), *scenario_files(incomplete)]
    return [name for name in names if name.startswith(incomplete)]


def complete_plotted(ctx: typer.Context, incomplete: str) -> list[str | tuple[str, str]]:
    from paddlectl.cli.completion import plotted_names

    runs = _beginning(plotted_names(ctx.params.get("registry"), incomplete), incomplete)
    return [*runs, *complete_results(incomplete)]


def one_method_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A completion of these names, and of the methods of plug-ins, none of which is imported for it."""

    def complete(incomplete: str) -> list[str]:
        from paddlectl.methods.catalogue import PLUGINS

        return [name for name in (*names, *PLUGINS.names()) if name.startswith(incomplete)]

    return complete


def run_task_files(context: typer.Context, files: list[Path] | None) -> list[Path] | None:
    """Runs the files of `--tasks` and takes in their tasks; says so in a line."""
    if files and not context.resilient_parsing:
        from paddlectl.tasks.suite import add_file

        for file in dict.fromkeys(file.resolve() for file in files):
            if not file.is_file():
                raise NotFoundError(f"no file {file}", "name a Python file")
            print(f"note: the code of {file} is run, for its tasks", file=sys.stderr)
            add_file(file)
    return files


def whole_number(low: int, high: int) -> Callable[[object], int]:
    """A parser of whole numbers within [low, high]: `400000`, `4e5` or `400000.0`."""

    def number(text: object) -> int:
        from paddlectl.registry.names import shortened
        from paddlectl.whole import advice, whole

        found = whole(str(text))
        if found is None:
            raise typer.BadParameter(f"{shortened(str(text))!r} is no whole number; {advice(str(text))}")
        if not low <= found <= high:
            raise typer.BadParameter(f"{found} is not in the range {low} to {high}")
        return found

    return number


def one_seed(text: object) -> int:
    """A parser of one seed."""
    from paddlectl.whole import seeds

    with suppress(UsageError):
        if len(seeds(str(text))) > 1:
            raise typer.BadParameter(f"{str(text)!r} are several seeds; write --seeds {text}")
    return whole_number(0, SEEDS - 1)(text)


def at_home(text: str) -> str:
    """The path with the home folder for `~` or `~user` at its start, which shells leave alone in `--x=~/y`.

    Raises:
        UsageError: If there is no such user.
    """
    path = os.path.expanduser(text)  # noqa: PTH111 - a Path would change `./~x` to `~x`
    if path.startswith("~"):
        user = path.partition("/")[0]
        raise UsageError(f"there is no home folder {user}", f"for a name that begins so, write ./{path}")
    return path


def place(text: str) -> str:
    """A registry's place with home folders as in `at_home`: `~/x`, `sqlite:///~/x`, `postgresql://…?files=~/x`."""
    if "://" not in text:
        return at_home(text)
    if text.startswith("sqlite:///"):
        return at_home(text.removeprefix("sqlite:///"))
    return re.sub(r"(?<=[?&]files=)(?:~|%7[eE])[^&]*", _files_at_home, text)


def _files_at_home(found: re.Match[str]) -> str:
    from urllib.parse import quote, unquote_plus

    return quote(at_home(unquote_plus(found[0])))


def file_at(text: str) -> Path:
    """A path, with home folders as in `at_home`."""
    return Path(at_home(text))


FRAMES = whole_number(1, MOST_FRAMES)

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
RegistryPlace = Annotated[
    str,
    typer.Option(
        "--registry",
        envvar=REGISTRY,
        parser=place,
        metavar="FOLDER",
        help="Where policies and runs are kept.",
    ),
]
TaskFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--tasks",
        parser=file_at,
        is_eager=True,
        callback=run_task_files,
        metavar="FILE.py",
        help="Tasks of your own, by name in its TASKS. Its code is run! Repeat for more.",
        show_default=False,
    ),
]
EveryRow = Annotated[bool, typer.Option("--all", help="All of them.")]
MostRows = Annotated[
    int | None,
    typer.Option(
        "--limit", min=1, max=2**31 - 1, metavar="N", help="The newest N; 50 without.", show_default=False
    ),
]
OfTask = Annotated[
    str | None,
    typer.Option(
        "--task", metavar="TASK", autocompletion=complete_tasks, help="Of this task.", show_default=False
    ),
]
OfMethod = Annotated[
    str | None, typer.Option("--method", metavar="METHOD", help="By this method.", show_default=False)
]
CheckpointEvery = Annotated[
    float | None,
    typer.Option(
        "--checkpoint-every",
        min=0.0,
        metavar="SECONDS",
        help="What a killed run loses at most; 30 without.",
        show_default=False,
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", min=1, metavar="N", help="Runs at a time; as many as CPUs without.", show_default=False
    ),
]
Held = Annotated[
    str,
    typer.Argument(
        metavar="POLICY|RUN",
        autocompletion=complete_held,
        help="A policy's or a run's id, a run's name, or a task's name or file for its best policy.",
        show_default=False,
    ),
]
OneSeed = Annotated[
    int | None,
    typer.Option("--seed", parser=one_seed, metavar="N", help="One seed.", show_default=False),
]
StudyFrames = Annotated[
    int | None,
    typer.Option(
        "--frames",
        parser=FRAMES,
        metavar="N",
        help="Environment steps of each transfer, instead of the study's.",
        show_default=False,
    ),
]
Changed = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Another number for what learns here, not for its sources: low_level.learning_rate=1e-3,"
        " rules.target_floor=0; repeat for more.",
        show_default=False,
    ),
]
RunName = Annotated[
    str | None,
    typer.Option(
        "--name",
        metavar="NAME",
        help="What to call the run, instead of its id; of one run only.",
        show_default=False,
    ),
]
Tags = Annotated[
    list[str] | None,
    typer.Option(
        "--tag", metavar="TAG", help="A word to find the runs by; repeat for more.", show_default=False
    ),
]
ManySeeds = Annotated[
    str | None,
    typer.Option("--seeds", metavar="N-M", help="Several: 0-5, or 0,3,7.", show_default=False),
]


def asked_for(**columns: str | None) -> dict[str, str]:
    """Those that were given; a task's file stands for its name.

    Raises:
        UsageError: If one can't be the name of anything.
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task.
    """
    from paddlectl.registry.names import shown
    from paddlectl.tasks.naming import content, given, is_file

    for name, value in columns.items():
        if value is not None and not (value and value.isprintable()):
            raise UsageError(f"--{name} can't be {shown(value)}", f"leave out --{name} for all of them")
    if (task := columns.get("task")) is not None and is_file(task):
        columns["task"] = content(given(at_home(task))).name
    return {name: value for name, value in columns.items() if value is not None}


def note_unknown(wanted: dict[str, str]) -> None:
    """Says of a list that came out empty if there is no such task or method as it was asked for."""
    from paddlectl.cli.texts import one_line
    from paddlectl.methods import catalogue
    from paddlectl.registry.names import nearest, shown
    from paddlectl.tasks import suite

    for noun, room in (("task", suite), ("method", catalogue)):
        name = wanted.get(noun)
        if name is not None and not room.known(name):
            near = nearest(name, room.names()).removesuffix(" or ")
            print(one_line(f"note: there is no {noun} {shown(name)}{near and f'; {near}'}"), file=sys.stderr)


def most_rows(every: bool, limit: int | None) -> int | None:
    """How many rows `--all` and `--limit` ask for; None is all.

    Raises:
        UsageError: If both are given.
    """
    if every and limit is not None:
        raise UsageError("--all and --limit exclude each other", "leave one of them out")
    return None if every else limit or LISTED


def chosen_seeds(seed: int | None, seeds: str | None, default: tuple[int, ...]) -> tuple[int, ...]:
    """The seeds that `--seed` or `--seeds` name, else the default.

    Raises:
        UsageError: If both are given, or one makes no sense.
    """
    from paddlectl.whole import seeds as parsed

    if seed is not None and seeds is not None:
        raise UsageError("--seed and --seeds exclude each other", "leave one of them out")
    if seeds is not None:
        return parsed(seeds)
    if seed is None:
        return default
    return (seed,)
