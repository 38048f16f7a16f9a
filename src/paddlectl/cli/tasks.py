"""`paddlectl tasks`."""

import sys
from typing import TYPE_CHECKING

from paddlectl.cli.options import AsJson, TaskFiles

if TYPE_CHECKING:
    from paddlectl.errors import PaddlectlError

EXAMPLE = "Example: paddlectl tasks --json"


def tasks(task_files: TaskFiles = None, as_json: AsJson = False) -> None:
    """List the tasks that can be trained on and transferred to."""
    from paddlectl.methods.catalogue import METHODS
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TASKS, table
    from paddlectl.tasks.suite import usable

    rows = [
        {
            "name": task.name,
            "domain": task.domain,
            "horizon": task.horizon,
            "heads": [str(subgoal) for subgoal in task.subgoals],
            "vocabulary": [str(atom) for atom in task.vocabulary.atoms],
            "summary": task.summary,
            "presets": list(METHODS["hdm"].presets.get(task.domain, ())),
        }
        for task in usable(_tell)
    ]
    if as_json:
        print_json({"tasks": rows})
    else:
        print_text([table(TASKS, rows)])


def _tell(broken: "PaddlectlError") -> None:
    from paddlectl.cli.texts import one_line

    print(one_line(f"note: {broken.message}; {broken.hint}"), file=sys.stderr)
