"""What defines a task, as a task file has it."""

import json
from collections.abc import Mapping
from typing import Any

from paddlectl.report.output import clean


def definition_lines(definition: Mapping[str, Any]) -> list[str]:
    """A line for each key; a file of them defines the task again."""
    return [clean(f"{key}: {_written(key, value)}") for key, value in definition.items()]


def _written(key: str, value: Any) -> str:
    """Words as they are; what a user wrote in quotes, as YAML may read it otherwise."""
    if isinstance(value, list):
        return f"[{', '.join(map(str, value))}]"
    return json.dumps(value, ensure_ascii=False) if key in ("name", "summary") else str(value)
