"""`paddlectl explain`."""

from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, complete_runs
from paddlectl.errors import NotFoundError

if TYPE_CHECKING:
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry

LATEST = "latest"
EXAMPLE = "Example: paddlectl explain run-42"


def explain(
    run: Annotated[
        str, typer.Argument(metavar="RUN", autocompletion=complete_runs, help="A transfer's run; or latest.")
    ] = LATEST,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Tell why a transfer acted as it did: program, Ψ, weights per scene, one episode."""
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
        print_text(explanation_parts(document, record))


def transfer_run(registry: "Registry", run: str) -> "RunRecord":
    """The run of that id, or the newest transfer.

    Raises:
        NotFoundError: If there is none, or it isn't a transfer.
    """
    if run == LATEST:
        if newest := registry.newest_transfer():
            return newest
        raise NotFoundError(
            f"no transfer in {registry.shown}", "run: paddlectl transfer scenarios/A.yaml --train-missing"
        )
    record = registry.run(run)
    if record.kind != "transfer":
        hint = f"run: paddlectl show {record.policy}" if record.policy else "run: paddlectl runs"
        raise NotFoundError(f"{record.id} trained a source; explain is for transfers", hint)
    return record
