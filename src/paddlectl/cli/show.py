"""`paddlectl show`."""

from typing import Annotated

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, TaskFiles, complete_held

EXAMPLE = "Example: paddlectl show GapBall"


def show(
    name: Annotated[
        str,
        typer.Argument(
            metavar="POLICY|RUN",
            autocompletion=complete_held,
            help="A policy's or a run's id, a run's name, or a task's name for its best policy.",
            show_default=False,
        ),
    ],
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Show a policy's clause program, raw and minimised, or a run; and by which numbers it learned."""
    from paddlectl.cli.named import held
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.programs import program_document, program_parts
    from paddlectl.report.settings import numbers, numbers_parts, run_document, run_parts

    opened = Registry.open(registry, create=False)
    record = held(opened, name)
    if isinstance(record, RunRecord):
        document = run_document(record)
        parts = run_parts(document)
    else:
        document = {**program_document(record), **numbers(opened.run(record.run))}
        parts = [*program_parts(document), *numbers_parts(document, record.method)]
    if as_json:
        print_json(document)
    else:
        print_text(parts)
