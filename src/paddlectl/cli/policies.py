"""`paddlectl policies`."""

from paddlectl.cli.options import AsJson, RegistryPlace

EXAMPLE = "Example: paddlectl policies --json"


def policies(registry: RegistryPlace = "registry", as_json: AsJson = False) -> None:
    """List the policies in the registry, newest first."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import policies_document
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import POLICIES, table

    document = policies_document(Registry.open(registry, create=False).policies())
    if as_json:
        print_json(document)
    else:
        print_text([table(POLICIES, document["policies"])])
