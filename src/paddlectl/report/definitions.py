"""What defines a task, as a task file has it."""

import json
from collections.abc import Mapping
from typing import Any

from paddlectl.report.output import clean

_FREE = ("name", "summary")  # in quotes, as YAML may read otherwise what a user wrote there


def definition_lines(definition: Mapping[str, Any]) -> list[str]:
    """A line for each key and for each entry that has parts; a file of them defines the task again."""
    lines = []
    for key, value in definition.items():
        if isinstance(value, list) and any(isinstance(each, list | dict) for each in value):
            lines += [f"{key}:", *(f"  - {_flow(each)}" for each in value)]
        else:
            lines.append(f"{key}: {json.dumps(value, ensure_ascii=False) if key in _FREE else _flow(value)}")
    return [clean(line) for line in lines]


def _flow(value: Any) -> str:
    """Words as they are."""
    match value:
        case list():
            return f"[{', '.join(map(_flow, value))}]"
        case dict():
            return f"{{{', '.join(f'{key}: {_flow(each)}' for key, each in value.items())}}}"
        case bool():
            return str(value).lower()
    return str(value)
