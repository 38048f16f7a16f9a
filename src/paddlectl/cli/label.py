"""`paddlectl label`."""

from typing import Annotated

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, complete_runs
from paddlectl.errors import UsageError

EXAMPLE = "Example: paddlectl label run-42 --name baseline --tag paper"


def label(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...",
            autocompletion=complete_runs,
            help="Ids or names; or latest.",
            show_default=False,
        ),
    ],
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="What to call the run; empty for nothing.", show_default=False),
    ] = None,
    tag: Annotated[
        list[str] | None,
        typer.Option(metavar="TAG", help="A word to find them by; repeat for more.", show_default=False),
    ] = None,
    untag: Annotated[
        list[str] | None, typer.Option(metavar="TAG", help="A tag to take off.", show_default=False)
    ] = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Give runs a name or tags, to find them by."""
    from paddlectl.cli.named import require_no_task
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import run_row
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import LABELLED, table

    if name is None and not tag and not untag:
        raise UsageError("nothing to change", "add --name, --tag or --untag")
    if name is not None and len(runs) > 1:
        raise UsageError(f"--name is of one run, and {len(runs)} are named", "use --tag")
    if name:
        require_no_task(name)
    with Registry.open(registry, create=False) as opened:
        changed = opened.label_runs(runs, name=name, tags=tag or (), untagged=untag or ())
    rows = [run_row(run) for run in changed]
    if as_json:
        print_json({"runs": rows})
    else:
        print_text([table(LABELLED, rows)])
