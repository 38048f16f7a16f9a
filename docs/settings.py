"""Writes docs/settings.md, every number of every method, from the settings' own docstrings.

python docs/settings.py
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from paddlectl import shipped
from paddlectl.agents.settings import leaves
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import TransferJob
from paddlectl.experiments.runner import rules_of, settings_of
from paddlectl.methods.catalogue import METHODS, require_actions
from paddlectl.scenario import Scenario, load_scenario
from paddlectl.tasks.suite import load

PAGE = Path(__file__).parent / "settings.md"
SCENARIOS = {"MiniGrid": "A", "maze": "maze"}
INTRODUCTION = """\
# Every setting

What `--set NAME=VALUE` of `train` and `transfer` can change, and `settings:` and `rules:` of
[scenarios and studies](scenarios.md): for each method all its numbers, what they usually are, and what they
do. Names with `rules.` are numbers of the guidance. There are two values where MiniGrid's tasks and
the maze's differ. This page is made from the code by `python docs/settings.py`, and a test compares them.
"""


def meanings(kind: type) -> dict[str, str]:
    """Each field of a settings class -> what its docstring says of it."""
    told: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        text = inspect.cleandoc(each.__doc__ or "") if is_dataclass(each) else ""
        _, _, attributes = text.partition("Attributes:\n")
        for entry in re.split(r"\n(?=    \S)", "\n" + attributes.split("\n\n")[0])[1:]:
            names, _, meaning = " ".join(entry.split()).partition(": ")
            told |= dict.fromkeys(re.split(r", | and ", names), meaning)
    return told


def explained(settings: Any, before: str = "") -> Iterator[tuple[str, str]]:
    """The name of each setting, as `--set` takes it, and its meaning."""
    told = meanings(type(settings))
    for each in fields(settings):
        value = getattr(settings, each.name)
        if is_dataclass(value):
            yield from explained(value, f"{before}{each.name}.")
        else:
            yield before + each.name, told.get(each.name, "")


def usual(name: str, scenario: Scenario) -> dict[str, tuple[str, str]] | None:
    """Of each setting of a method its value in a scenario and its meaning; None if it can't learn that."""
    try:
        require_actions(name, load(scenario.target))
    except PaddlectlError:
        return None
    job, found = TransferJob(scenario, (), name, 0, scenario.frames), {}
    for settings, before in ((settings_of(job), ""), (rules_of(job), "rules.")):
        if settings is not None:
            values = dict(leaves(settings, before))
            found |= {key: (written(values[key]), told) for key, told in explained(settings, before)}
    return found


def written(value: Any) -> str:
    """`[64,64]`, `0.0003`: as `--set` takes it."""
    if isinstance(value, tuple):
        return f"[{','.join(map(written, value))}]"
    return str(value).lower() if isinstance(value, bool) or value is None else f"{value}"


def page() -> str:
    """The whole page."""
    parts = [INTRODUCTION]
    scenarios = {domain: load_scenario(shipped.scenario(name)) for domain, name in SCENARIOS.items()}
    for name in METHODS:
        of = {domain: found for domain, each in scenarios.items() if (found := usual(name, each))}
        parts.append(f"\n## `{name}`\n\n| setting | usually | what it does |\n|---|---|---|\n")
        for key in dict.fromkeys(key for found in of.values() for key in found):
            values = {domain: found[key][0] for domain, found in of.items() if key in found}
            told = next(found[key][1] for found in of.values() if key in found)
            same = len(set(values.values())) == 1 and len(values) == len(of)
            value = (
                f"`{next(iter(values.values()))}`"
                if same
                else ", ".join(f"`{each}` ({domain})" for domain, each in values.items())
            )
            parts.append(f"| `{key}` | {value} | {told.replace('|', chr(92) + '|')} |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"{PAGE}: written")
