"""`paddlectl show`."""

from paddlectl.cli.options import AsJson, Held, RegistryPlace, TaskFiles

EXAMPLE = "Example: paddlectl show GapBall"


def show(
    name: Held,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Show a policy's clause program, raw and minimised, or a run; and by which numbers it learned."""
    from paddlectl.cli.named import held
    from paddlectl.registry.records import RunRecord
    from paddlectl.registry.store import Registry
    from paddlectl.report.mapping import labels_of
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.programs import program_document, program_parts
    from paddlectl.report.settings import numbers, numbers_parts, run_document, run_parts

    opened = Registry.open(registry, create=False)
    record = held(opened, name)
    if isinstance(record, RunRecord):
        document = run_document(opened.so_far(record))
        parts = run_parts(document, labels_of(opened, record))
    else:
        document = {**program_document(record), **numbers(opened.run(record.run))}
        parts = [*program_parts(document), *numbers_parts(document, record.method)]
    if as_json:
        print_json(document)
    else:
        print_text(parts)
