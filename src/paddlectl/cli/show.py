"""`paddlectl show`."""

from paddlectl.cli.options import AsJson, PolicyName, RegistryPlace

EXAMPLE = "Example: paddlectl show GapBall"


def show(policy: PolicyName, registry: RegistryPlace = "registry", as_json: AsJson = False) -> None:
    """Show a policy's clause program: raw with probabilities, and minimised."""
    from paddlectl.cli.named import policy_named
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.programs import program_document, program_parts

    record = policy_named(Registry.open(registry, create=False), policy)
    document = program_document(record)
    if as_json:
        print_json(document)
    else:
        print_text(program_parts(document))
