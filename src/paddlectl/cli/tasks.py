"""`paddlectl tasks`."""

from paddlectl.cli.options import AsJson

EXAMPLE = "Example: paddlectl tasks --json"


def tasks(as_json: AsJson = False) -> None:
    """List the tasks that can be trained on and transferred to."""
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TASKS, table
    from paddlectl.tasks.suite import load, names

    rows = [
        {
            "name": task.name,
            "domain": task.domain,
            "horizon": task.horizon,
            "heads": [str(head) for head in task.heads],
            "vocabulary": [str(atom) for atom in task.vocabulary.atoms],
            "summary": task.summary,
            "presets": list(task.presets),
        }
        for task in map(load, names())
    ]
    if as_json:
        print_json({"tasks": rows})
    else:
        print_text([table(TASKS, rows)])
