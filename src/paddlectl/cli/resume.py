"""`paddlectl resume`."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import AsJson, CheckpointEvery, RegistryPlace, complete_stopped
from paddlectl.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry

EXAMPLE = "Example: paddlectl resume run-7"


def resume(
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN...",
            autocompletion=complete_stopped,
            help="Runs that were stopped; they go on side by side.",
            show_default=False,
        ),
    ] = None,
    every_stopped: Annotated[bool, typer.Option("--all", help="All that were stopped.")] = False,
    checkpoint_every: CheckpointEvery = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Go on exactly where a stopped run was; it ends as if it had never been stopped."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import RESUMED, table

    with Registry.open(registry, create=False) as opened:
        stopped = stopped_runs(opened, runs or [], every_stopped)
    if not stopped:
        print_json({"runs": []}) if as_json else print_text(["no run was stopped"])
        return
    with stdout_kept():
        from paddlectl.cli.running import run
        from paddlectl.experiments.jobs import ResumeJob
        from paddlectl.experiments.pace import require_resumable

        for record in stopped:
            require_resumable(record)
            warn_of_versions(record)
        names = [f"{record.id} {record.method} {record.task}" for record in stopped]
        rows = run([ResumeJob(record.id) for record in stopped], names, registry, checkpoint_every)
    if as_json:
        print_json({"runs": rows})
    else:
        print_text([table(RESUMED, rows, "Resumed")])


def stopped_runs(registry: "Registry", names: "Sequence[str]", every: bool) -> "list[RunRecord]":
    """The runs named, or all that were stopped and nobody goes on with.

    Raises:
        UsageError: If neither or both is asked for.
        NotFoundError: If there is no such run.
    """
    if every == bool(names):
        raise UsageError("which run?", "name it, as in: paddlectl resume run-7, or say --all")
    if names:
        return [registry.run(name) for name in dict.fromkeys(names)]
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
