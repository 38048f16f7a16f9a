"""`paddlectl explain`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, TaskFiles, complete_transfers, file_at
from paddlectl.cli.output_files import require_output, write_output
from paddlectl.errors import NotFoundError
from paddlectl.registry.names import LATEST

if TYPE_CHECKING:
    from collections.abc import Mapping

    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry

SCENARIO = "A"
EXAMPLE = "Example: paddlectl explain run-42"


def explain(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            autocompletion=complete_transfers,
            help="A transfer's run, by id or name; or latest.",
        ),
    ] = LATEST,
    full: Annotated[
        bool, typer.Option("--full", help="Tell everything, on a terminal in a pager; else 40 lines at most.")
    ] = False,
    html: Annotated[
        Path | None,
        typer.Option(
            "--html",
            parser=file_at,
            metavar="FILE",
            help="Write it there as a page, with pictures; it needs no network.",
            show_default=False,
        ),
    ] = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Tell why a transfer acted as it did: program, Ψ, weights per scene, two episodes."""
    from paddlectl.cli.texts import here
    from paddlectl.registry.store import Registry
    from paddlectl.report.explained import explanation_parts
    from paddlectl.report.explanation import explanation_document
    from paddlectl.report.output import clean, print_json, print_paged, print_text
    from paddlectl.report.summary import summary_parts

    if html is not None:
        require_output(html, ".html", ".htm")
    opened = Registry.open(registry, create=False)
    record = opened.so_far(transfer_run(opened, run))
    document = explanation_document(opened, record, recorded=as_json)
    if html is not None:
        _write(html, opened, record, document)
    if as_json:
        print_json(document)
    elif html is not None:
        print_text([clean(f"{record.id} is explained in {html}")])
    else:
        told = explanation_parts(document, record) if full else summary_parts(document, record)
        parts = [here(part) if isinstance(part, str) else part for part in told]
        (print_paged if full else print_text)(parts)


def _write(path: Path, registry: "Registry", run: "RunRecord", document: "Mapping[str, Any]") -> None:
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.report.page import explanation_page

    with stdout_kept():  # environments that are drawn may print
        page = explanation_page(registry, run, document)
    write_output(path, page.encode())


def transfer_run(registry: "Registry", run: str) -> "RunRecord":
    """The run of that id, or the newest transfer.

    Raises:
        NotFoundError: If there is none, or it isn't a transfer.
    """
    from paddlectl.registry.index.queries import next_step

    if run == LATEST:
        if newest := registry.newest_transfer():
            return newest
        way = f"paddlectl transfer {SCENARIO} --train-missing"
        raise NotFoundError(f"no transfer in {registry.shown}", f"run: {way}")
    record = registry.run(run)
    if record.kind != "transfer":
        raise NotFoundError(f"{record.id} trained a source; explain is for transfers", next_step(record))
    return record
