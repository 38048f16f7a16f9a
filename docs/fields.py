"""Writes docs/json.md, the fields of every command's --json, from the schemas in src/paddlectl/schemas.

python docs/fields.py
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import paddlectl

PAGE = Path(__file__).parent / "json.md"
SCHEMAS = Path(paddlectl.__file__).parent / "schemas"
INTRODUCTION = """\
# What `--json` prints

One JSON document on stdout and nothing else there; numbers that JSON lacks are null. This page is made from
the JSON Schemas in `src/paddlectl/schemas/` (`python docs/fields.py`), and a test holds all commands to them:
a document has all of these fields and no others, but for those marked *not always*. This is version
{version}; a field that goes, or comes to mean something else, raises it, and a new field does not.
"""


def schemas() -> dict[str, Any]:
    """Command, as `registry check` -> its schema."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(SCHEMAS.glob("*.json"))]
    return {schema["title"].removeprefix("paddlectl ").removesuffix(" --json"): schema for schema in found}


def page() -> str:
    (version,) = {schema["version"] for schema in schemas().values()}
    parts = [INTRODUCTION.format(version=version)]
    for command, schema in schemas().items():
        rows = [f"| `{path}` | {kind} | {told} |" for path, kind, told in fields("", schema) if path]
        for name, one in schema.get("$defs", {}).items():
            rows += [
                f"| *{name}*`.{path}` | {kind} | {told} |" for path, kind, told in fields("", one) if path
            ]
        parts.append(
            f"\n## `{command}`\n\n{schema['description']}\n\n| field | is | what it is |\n|---|---|---|\n"
        )
        parts.append("".join(f"{row}\n" for row in rows))
    return "".join(parts)


def fields(path: str, schema: Any, note: str = "") -> Iterator[tuple[str, str, str]]:
    """Path, type and meaning of a value and of all in it."""
    told = " ".join(filter(None, [schema.get("description", "").replace("|", "\\|"), note]))
    yield path, _kind(schema), told
    for name, value in schema.get("properties", {}).items():
        always = "" if name in schema["required"] else "*Not always.*"
        yield from fields(f"{path}.{name}".lstrip("."), value, always)
    if "items" in schema:
        _, *inner = fields(f"{path}[]", schema["items"])
        yield from inner


def _kind(schema: Any) -> str:
    """`array of string or null`."""
    if "$ref" in schema:
        return f"*{schema['$ref'].rpartition('/')[2]}*"
    if "anyOf" in schema:
        return " or ".join(map(_kind, schema["anyOf"]))
    if "enum" in schema:
        return " or ".join(f"`{value}`" for value in schema["enum"])
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    inner = schema.get("items") or schema.get("additionalProperties") or {}
    of = f" of {_kind(inner)}" if inner else ""
    return " or ".join(f"{kind}{of if kind in ('array', 'object') else ''}" for kind in kinds)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
