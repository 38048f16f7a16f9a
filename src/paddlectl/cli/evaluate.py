"""`paddlectl evaluate`."""

from typing import Annotated

import typer

from paddlectl.cli.options import AsJson, Held, RegistryPlace, TaskFiles, complete_tasks, whole_number
from paddlectl.registry.fields import SEEDS

EXAMPLE = "Example: paddlectl evaluate BoxDoor --episodes 200 --json"


def evaluate(
    policy: Held,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="TASK",
            autocompletion=complete_tasks,
            help="Another task of the same domain, or a task file; without: the policy's own.",
            show_default=False,
        ),
    ] = None,
    episodes: Annotated[
        int, typer.Option(parser=whole_number(1, 1_000_000), metavar="N", help="Layouts to play.")
    ] = 200,
    seed: Annotated[
        int, typer.Option(parser=whole_number(0, SEEDS - 1), metavar="N", help="Decides the layouts.")
    ] = 12345,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Play a policy on layouts that it never trained on."""
    from paddlectl.cli.named import learned, task_named
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import EVALUATED, table
    from paddlectl.tasks.suite import load

    other = task_named(task) if task is not None else None
    if other is not None:
        load(other)  # what there isn't is told before a registry is looked for
    opened = Registry.open(registry, create=False)
    record = learned(opened, policy)
    with stdout_kept():
        from paddlectl.experiments.policies import evaluate as play

        row = play(opened, record, other or record.task, episodes, seed)
    if as_json:
        print_json(row)
    else:
        print_text([table(EVALUATED, [row])])
