"""`paddlectl policies`."""

from paddlectl.cli.options import (
    AsJson,
    EveryRow,
    MostRows,
    OfMethod,
    OfTask,
    RegistryPlace,
    asked_for,
    most_rows,
    note_unknown,
)

EXAMPLE = "Example: paddlectl policies --json"


def policies(
    task: OfTask = None,
    method: OfMethod = None,
    every: EveryRow = False,
    limit: MostRows = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """List the policies in the registry, newest first."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import policies_document
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import POLICIES, listed

    most = most_rows(every, limit)
    wanted = asked_for(task=task, method=method)
    document = policies_document(*Registry.open(registry, create=False).newest_policies(most, wanted))
    if not document["policies"]:
        note_unknown(wanted)
    if as_json:
        print_json(document)
    else:
        print_text(listed(POLICIES, document["policies"], document["total"]))
