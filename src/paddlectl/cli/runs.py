"""`paddlectl runs`."""

from paddlectl.cli.options import AsJson, RegistryPlace

EXAMPLE = "Example: paddlectl runs --json"


def runs(registry: RegistryPlace = "registry", as_json: AsJson = False) -> None:
    """List the runs in the registry, newest first."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import runs_document
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import RUNS, table

    document = runs_document(Registry.open(registry, create=False).runs())
    if as_json:
        print_json(document)
    else:
        print_text([table(RUNS, document["runs"])])
