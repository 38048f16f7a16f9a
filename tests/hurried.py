"""Jobs whose own processes evaluate on few layouts, as `trials.runs.small` does within one process."""

from pathlib import Path

import pytest

CODE = """
from paddlectl.experiments import policies

policies.EVALUATION_EPISODES = 8
TASKS = {"Nothing": str}
"""


def hurry(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """Has each process of a job load a file of tasks that does it, as if a user had named the file."""
    file = folder / "hurry.py"
    file.write_text(CODE)
    patch.setattr("paddlectl.plugins.files", lambda: (file,))
