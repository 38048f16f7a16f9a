"""`paddlectl registry check | repair | gc | delete | export | import | upgrade`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, RunName, Tags, complete_held, file_at
from paddlectl.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.care.findings import Finding, Report

app = typer.Typer(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
EXAMPLE = "Example: paddlectl registry check --read-data"
DAMAGED = 5


@app.callback()
def registry() -> None:
    """Check, mend, clean, move and upgrade the registry."""


@app.command(epilog="Example: paddlectl registry check --read-data")
def check(
    read_data: Annotated[
        bool, typer.Option("--read-data", help="Also read every byte and compare its SHA-256.")
    ] = False,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> int:
    """Look for anything missing, changed or left over; changes nothing. Exit 5 if there is a fault."""
    from paddlectl.cli.texts import here
    from paddlectl.registry.care import check as checking
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import FINDINGS, table

    report = checking.check(registry, read_data=read_data)
    rows = _rows(report.findings)
    if as_json:
        counts = {"rows": len(report.rows), "files": report.files, "bytes": report.bytes}
        print_json({**counts, "faults": len(report.faults), "findings": rows})
    else:
        looked = f"{len(report.rows)} rows, {report.files} files" + (
            f", {report.bytes:,} bytes read" if read_data else "; --read-data reads every byte"
        )
        told = f"{len(report.faults)} faults{_mending(report)}" if report.faults else "sound"
        shown = [row | {"what": here(row["what"])} for row in rows]
        print_text([*([table(FINDINGS, shown)] if rows else []), here(f"{told} ({looked})")])
    return DAMAGED if report.faults else 0


@app.command(epilog="Example: paddlectl registry repair")
def repair(
    drop_lost: Annotated[
        bool, typer.Option("--drop-lost", help="Let runs and policies go whose data are lost.")
    ] = False,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> int:
    """Make the index again from manifests and objects, tell each change, and throw nothing away.

    Exit 5 if something can't be mended, or a run or policy would be lost; nothing is changed then.
    """
    from paddlectl.registry.care import repair as mending
    from paddlectl.report.output import clean, print_json, print_text
    from paddlectl.report.tables import FINDINGS, table

    told = mending.repair(registry, drop_lost=drop_lost)
    rows = _rows(told.left)
    if as_json:
        print_json({"done": told.done, "lost": told.lost, "left": rows})
    elif told.lost:
        print_text(
            [*map(clean, told.lost), f"{len(told.lost)} would be lost, so nothing was changed; {_DROP}"]
        )
    else:
        print_text([clean(line) for line in told.done] or ["nothing to mend"])
        print_text([table(FINDINGS, rows, "Can't be mended")] if rows else [])
    return DAMAGED if rows or told.lost else 0


@app.command(epilog="Example: paddlectl registry gc --dry-run")
def gc(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    older_than: Annotated[
        float, typer.Option(min=0.0, metavar="SECONDS", help="Spare what is younger: a writer may need it.")
    ] = 3600.0,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Remove what is left over: files that no run and no policy needs."""
    from paddlectl.registry.care.garbage import collect
    from paddlectl.report.output import clean, print_json, print_text

    removed = collect(registry, grace=older_than, dry=dry_run)
    size = sum(bytes_ for _, bytes_ in removed)
    if as_json:
        print_json({"removed": [{"file": name, "bytes": bytes_} for name, bytes_ in removed], "bytes": size})
    else:
        what = "would go" if dry_run else "removed"
        print_text([*(clean(name) for name, _ in removed), f"{len(removed)} files {what}, {size:,} bytes"])


@app.command(epilog="Example: paddlectl registry delete run-42")
def delete(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN|POLICY...",
            autocompletion=complete_held,
            help="Ids, or names of runs. A run and its policy go together.",
            show_default=False,
        ),
    ],
    with_dependants: Annotated[
        bool, typer.Option("--with-dependants", help="Also delete runs that built on them.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Don't ask.")] = False,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Delete runs with their policies, for good, after they were listed."""
    from paddlectl.registry.care.deletion import chosen_runs, remove
    from paddlectl.report.documents import run_row
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import RUNS, file_size, table

    chosen = chosen_runs(registry, names, with_dependants=with_dependants)
    if not as_json:
        print_text([table(RUNS, map(run_row, chosen))])
    if not (yes or _agreed(len(chosen))):
        raise UsageError("nothing was deleted", "add --yes to delete what is listed")
    freed = remove(registry, chosen)
    if as_json:
        print_json({"deleted": [{"run": run.id, "policy": run.policy} for run in chosen], "bytes": freed})
    else:
        print_text([f"deleted; {file_size(freed)} are free now"])


def _agreed(count: int) -> bool:
    """Whether the user, if there is one, says yes."""
    if not sys.stdin.isatty():
        return False
    what = "this run and its policy" if count == 1 else f"these {count:,} runs and their policies"
    print(f"Delete {what} for good? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


@app.command(epilog="Example: paddlectl registry export BoxDoor boxdoor.zip")
def export(
    name: Annotated[
        str,
        typer.Argument(
            metavar="POLICY|RUN",
            autocompletion=complete_held,
            help="A policy's id, a task's name for its best policy, or a run's id or name.",
            show_default=False,
        ),
    ],
    file: Annotated[
        Path,
        typer.Argument(parser=file_at, metavar="FILE", help="A new file; .zip is usual.", show_default=False),
    ],
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Write a policy, or a run with its tables, as one file: a zipped model folder with its card."""
    from paddlectl.cli.named import held
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.registry.bundles import bundles
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import clean, print_json, print_text
    from paddlectl.report.replay import replay_gif
    from paddlectl.tasks.naming import is_file

    with Registry.open(registry, create=False) as opened, stdout_kept():
        record = held(opened, name)
        known = isinstance(record, RunRecord) or is_file(name)
        name = record.id if known else name
        told = bundles.export(opened, name, file, lambda policy: replay_gif(opened, policy))
    if as_json:
        print_json(told)
    else:
        print_text([clean(f"{told['exported']} is in {told['file']} ({told['bytes']:,} bytes)")])


@app.command("import", epilog="Example: paddlectl registry import boxdoor.zip")
def import_(
    file: Annotated[
        Path,
        typer.Argument(parser=file_at, metavar="FILE", help="What export wrote.", show_default=False),
    ],
    name: RunName = None,
    tag: Tags = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Take in what `export` wrote, wholly or not at all; anything else is refused with exit 5.

    Names and tags stay where they were given; --name and --tag give new ones.
    """
    from paddlectl.cli.named import UNLABELLED, labels_of
    from paddlectl.registry.bundles import bundles
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import clean, print_json, print_text

    labels = labels_of(name, tag, (), registry)
    told = bundles.import_(lambda: Registry.open(registry), file)
    if labels != UNLABELLED:
        with Registry.open(registry) as opened:
            opened.label_runs([told["run"]], name=labels.name, tags=labels.tags)
    if as_json:
        print_json(told)
    else:
        known = "was here already as" if told["known"] else "is"
        print_text([clean(f"{file} {known} {told['policy'] or told['run']}")])


@app.command(epilog="Example: paddlectl registry upgrade")
def upgrade(registry: RegistryPlace = "registry", as_json: AsJson = False) -> None:
    """Bring the registry to this version's schema; a copy of the old index is kept. Any use does so too."""
    from paddlectl.registry.schema import REVISIONS
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text

    Registry.open(registry, create=False).close()
    if as_json:
        print_json({"schema": REVISIONS[-1]})
    else:
        print_text([f"the registry has schema {REVISIONS[-1]}"])


_DROP = "restore the data, or run: paddlectl registry repair --drop-lost"


def _mending(report: "Report") -> str:
    """What mends the faults, if there is anything to mend them from."""
    sources = report.readable or report.manifests or report.older
    return "; run: paddlectl registry repair" if sources else "; restore the index from a copy"


def _rows(findings: "Sequence[Finding]") -> list[dict[str, Any]]:
    return [finding._asdict() for finding in findings]
