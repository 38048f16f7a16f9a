"""`paddlectl tasks`."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import AsJson, TaskFiles, complete_tasks

if TYPE_CHECKING:
    from paddlectl.errors import PaddlectlError
    from paddlectl.tasks.base import Task

EXAMPLE = "Example: paddlectl tasks --json"


def tasks(
    task: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TASK...",
            autocompletion=complete_tasks,
            help="Only these, names or task files, and what a file would tell of them.",
            show_default=False,
        ),
    ] = None,
    task_files: TaskFiles = None,
    as_json: AsJson = False,
) -> None:
    """List the tasks that can be trained on and transferred to."""
    from paddlectl.cli.named import task_named
    from paddlectl.report.definitions import definition_lines
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TASKS, table
    from paddlectl.tasks.suite import load, require_playable, usable

    found = [*map(load, map(task_named, task))] if task else [*filter(_made, usable(_tell))]
    for each in found if task else ():
        require_playable(each)
    rows = [_row(each) for each in found]
    if as_json:
        print_json({"tasks": rows})
        return
    print_text([table(TASKS, rows)])
    for row in rows if task else ():
        if row["definition"]:
            print_text([*definition_lines(row["definition"]), ""])


def _row(task: "Task") -> dict[str, Any]:
    from paddlectl.methods.catalogue import METHODS
    from paddlectl.tasks.minigrid.layouts import SPECS

    definition = SPECS[task.name].document() if task.name in SPECS else task.definition
    return {
        "name": task.name,
        "domain": task.domain,
        "horizon": task.horizon,
        "heads": [str(subgoal) for subgoal in task.subgoals],
        "vocabulary": [str(atom) for atom in task.vocabulary.atoms],
        "summary": task.summary,
        "presets": list(METHODS["hdm"].presets.get(task.domain, ())),
        "definition": definition,
    }


def _made(task: "Task") -> bool:
    """Whether its environment can be made and played, if it is of a file."""
    from paddlectl.errors import PaddlectlError
    from paddlectl.tasks.suite import require_playable

    try:
        require_playable(task)
    except PaddlectlError as error:
        _tell(error)
        return False
    return True


def _tell(broken: "PaddlectlError") -> None:
    from paddlectl.cli.texts import one_line

    print(one_line(f"note: {broken.message}; {broken.hint}"), file=sys.stderr)
