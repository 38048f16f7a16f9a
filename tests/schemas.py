"""Whether documents fit the schemas of `--json`, of which this knows as much of JSON Schema as they use."""

import json
from pathlib import Path
from typing import Any

import paddlectl

FOLDER = Path(paddlectl.__file__).parent / "schemas"
KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "integer": (int,), "number": (int, float),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip
KNOWN = {
    "$schema", "title", "version", "description", "type", "enum", "anyOf", "properties", "required", "items",
    "additionalProperties", "$defs", "$ref",
}  # fmt: skip


def schema_of(command: str) -> Any:
    return json.loads((FOLDER / f"{command.replace(' ', '-')}.json").read_text(encoding="utf-8"))


def misfits(value: Any, schema: Any, path: str = "", defs: Any = None) -> list[str]:
    """What is wrong with a value, each with its place; nothing if it fits."""
    assert schema.keys() <= KNOWN, schema.keys() - KNOWN
    defs = schema.get("$defs", defs)
    if "$ref" in schema:
        return misfits(value, defs[schema["$ref"].removeprefix("#/$defs/")], path, defs)
    if "anyOf" in schema:
        return min((misfits(value, one, path, defs) for one in schema["anyOf"]), key=len)
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if not any(
        isinstance(value, KINDS[kind]) and isinstance(value, bool) == (kind == "boolean") for kind in kinds
    ):
        return [f"{path}: {value!r:.60} is no {' or '.join(kinds)}"]
    if value not in schema.get("enum", [value]):
        return [f"{path}: {value!r:.60} is none of {schema['enum']}"]
    wrong = []
    if isinstance(value, dict):
        known, more = schema.get("properties", {}), schema.get("additionalProperties", {})
        wrong += [f"{path}: lacks {name}" for name in schema.get("required", ()) if name not in value]
        for name, item in value.items():
            if name in known:
                wrong += misfits(item, known[name], f"{path}.{name}", defs)
            elif more is False:
                wrong.append(f"{path}: has {name}, which no schema tells")
            elif more:
                wrong += misfits(item, more, f"{path}.{name}", defs)
    if isinstance(value, list) and "items" in schema:
        for index, item in enumerate(value):
            wrong += misfits(item, schema["items"], f"{path}[{index}]", defs)
    return wrong


def require_row(row: Any, command: str) -> None:
    """A row of `runs` in what a command prints."""
    schema = schema_of(command)
    items = schema["properties"]["runs"]["items"]
    wrong = misfits(json.loads(json.dumps(row)), items, defs=schema.get("$defs"))
    assert not wrong, wrong
