"""`paddlectl resume`."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import AsJson, CheckpointEvery, Jobs, RegistryPlace, TaskFiles, complete_stopped
from paddlectl.errors import PaddlectlError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.cli.running import Asked
    from paddlectl.experiments.jobs import Failure
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry

EXAMPLE = "Example: paddlectl resume run-7"


def resume(
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN...",
            autocompletion=complete_stopped,
            help="Ids or names of runs that were stopped; they go on side by side.",
            show_default=False,
        ),
    ] = None,
    every_stopped: Annotated[bool, typer.Option("--all", help="All that were stopped.")] = False,
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Go on exactly where a stopped run was; it ends as if it had never been stopped."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import RESUMED, table

    with stdout_kept():
        from paddlectl.cli.running import Ended, run

        with Registry.open(registry, create=False) as opened:
            asked, refused = resumable(opened, runs or [], every_stopped)
        done = run(asked, registry, checkpoint_every, jobs) if asked else Ended([], {})
    ended = Ended(done.rows, {**refused, **done.failed})
    if as_json:
        print_json({"runs": ended.rows, "failed": ended.documents()})
    elif ended.rows or not ended.failed:
        print_text([table(RESUMED, ended.rows, "Resumed")] if ended.rows else ["no run was stopped"])
    ended.require_all()


def resumable(
    registry: "Registry", names: "Sequence[str]", every: bool
) -> "tuple[list[Asked], dict[str, Failure]]":
    """The runs to go on with, and why others of those asked for can't go on.

    Raises:
        UsageError: If neither or both is asked for.
        PaddlectlError: What is wrong with the run, if only one is asked for.
    """
    if every == bool(names):
        raise UsageError("which run?", "name it, or run: paddlectl resume --all")
    names = list(dict.fromkeys(names)) or [run.id for run in stopped_runs(registry)]
    if not names:  # and nothing that takes long to load
        return [], {}
    from paddlectl.cli.running import Asked
    from paddlectl.experiments.checkpointer import require_resumable
    from paddlectl.experiments.jobs import Failure, ResumeJob

    asked, refused = [], {}
    for name in names:
        try:
            run = registry.run(name)
            require_resumable(run)
        except PaddlectlError as error:
            if len(names) == 1 and not every:
                raise
            refused[name] = Failure(name, error)
            continue
        warn_of_versions(run)
        frames = run.settings.get("frames")  # its process tells what is wrong with settings
        left = max(frames - run.frames, 0) if isinstance(frames, int) else 0
        label = f"{run.id} {run.method} {run.task}"
        asked.append(Asked(ResumeJob(run.id), label, run.kind, run.method, run.task, left))
    return asked, refused


def stopped_runs(registry: "Registry") -> "list[RunRecord]":
    """All runs that were stopped and that nobody goes on with, the oldest first."""
    return [run for run in registry.stopped_runs() if run.method != "random"]


def warn_of_versions(run: "RunRecord") -> None:
    """Says on stderr what is another version than when the run began."""
    from paddlectl.experiments.log import versions

    now = versions()
    changed = [
        f"{name} {run.versions[name]} is now {now[name]}"
        for name in run.versions
        if name in now and name != "platform" and run.versions[name] != now[name]
    ]
    if changed:
        print(f"note: {run.id} may not end as it would have: {', '.join(changed)}", file=sys.stderr)
