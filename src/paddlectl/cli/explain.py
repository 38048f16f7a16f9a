"""`paddlectl explain`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, TaskFiles, complete_transfers
from paddlectl.errors import NotFoundError

if TYPE_CHECKING:
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry

LATEST = "latest"
SCENARIO = "scenarios/A.yaml"
EXAMPLE = "Example: paddlectl explain run-42"


def explain(
    run: Annotated[
        str,
        typer.Argument(metavar="RUN", autocompletion=complete_transfers, help="A transfer's run; or latest."),
    ] = LATEST,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Tell why a transfer acted as it did: program, Ψ, weights per scene, one episode."""
    from paddlectl.cli.texts import here
    from paddlectl.registry.store import Registry
    from paddlectl.report.explained import explanation_parts
    from paddlectl.report.explanation import explanation_document
    from paddlectl.report.output import print_json, print_text

    opened = Registry.open(registry, create=False)
    record = transfer_run(opened, run)
    document = explanation_document(opened, record)
    if as_json:
        print_json(document)
    else:
        parts = explanation_parts(document, record)
        print_text([here(part) if isinstance(part, str) else part for part in parts])


def transfer_run(registry: "Registry", run: str) -> "RunRecord":
    """The run of that id, or the newest transfer.

    Raises:
        NotFoundError: If there is none, or it isn't a transfer.
    """
    from paddlectl.registry.index.queries import next_step

    if run == LATEST:
        if newest := registry.newest_transfer():
            return newest
        way = f"{SCENARIO} --train-missing" if Path(SCENARIO).is_file() else "--help"
        raise NotFoundError(f"no transfer in {registry.shown}", f"run: paddlectl transfer {way}")
    record = registry.run(run)
    if record.kind != "transfer":
        raise NotFoundError(f"{record.id} trained a source; explain is for transfers", next_step(record))
    return record
