"""`paddlectl runs`."""

from paddlectl.cli.options import AsJson, EveryRow, MostRows, RegistryPlace, most_rows

EXAMPLE = "Example: paddlectl runs --json"


def runs(
    every: EveryRow = False,
    limit: MostRows = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """List the runs in the registry, newest first."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import runs_document
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import RUNS, listed

    most = most_rows(every, limit)
    document = runs_document(*Registry.open(registry, create=False).newest_runs(most))
    if as_json:
        print_json(document)
    else:
        print_text(listed(RUNS, document["runs"], document["total"]))
