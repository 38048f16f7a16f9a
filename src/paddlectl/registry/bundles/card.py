"""The README of a bundle: a model card as model hubs read it, made from the bundle alone."""

import json
from typing import Any


def card(config: dict[str, Any], results: dict[str, Any], files: list[str]) -> str:
    """The card's Markdown, its metadata in front as YAML; values are JSON, which YAML reads too."""
    run, policy = config["run"], config["policy"]
    picture = "\n![An episode that it never trained on](replay.gif)\n" if "replay.gif" in files else ""
    symbolic, prolog = ("  - neuro-symbolic\n", _PROLOG) if "program.pl" in files else ("", "")
    task = run["task"]
    figures = results["policy"] or results["run"]
    numbers = {name: value for name, value in figures.items() if type(value) in (int, float)}
    metrics = "".join(
        f"          - type: {json.dumps(name)}\n            value: {json.dumps(value)}\n"
        f"            name: {json.dumps(name.replace('_', ' '))}\n            verified: false\n"
        for name, value in numbers.items()
    )
    index = f"""\
model-index:
  - name: {json.dumps(f"{run['method']}-{task}")}
    results:
      - task:
          type: reinforcement-learning
          name: reinforcement-learning
        dataset:
          name: {json.dumps(task)}
          type: {json.dumps(task)}
        metrics:
{metrics}"""
    return f"""\
---
library_name: paddlectl
pipeline_tag: reinforcement-learning
tags:
  - reinforcement-learning
{symbolic}  - {json.dumps(run["method"])}
  - {json.dumps(task)}
{index if metrics else ""}---

# {_plain(run["method"])} on {_plain(task)}
{picture}
{_what(run, policy)}

| figure | value |
|---|---|
{"".join(f"| {_plain(name)} | {json.dumps(value)} |{chr(10)}" for name, value in numbers.items())}
| file | holds |
|---|---|
{"".join(f"| `{name}` | {_HOLDS.get(name, 'a table or document of the run')} |{chr(10)}" for name in files)}
Use it: `paddlectl registry import FILE`, then `paddlectl evaluate {_plain(task)}`.{prolog}
"""


def _what(run: dict[str, Any], policy: dict[str, Any] | None) -> str:
    learned = f"Seed {run['seed']}, {run['frames']:,} environment steps, {run['episodes']:,} episodes"
    state = "" if run["status"] == "finished" else f" The run was {run['status']}."
    figures = " Figures are from layouts that it never trained on." if policy else ""
    return f"{learned}.{state}{figures}"


def _plain(text: object) -> str:
    """Text without anything that Markdown or HTML would read into it."""
    return "".join(c if c.isalnum() or c in " _-.,:" else "?" for c in str(text))


_PROLOG = " The program runs in any\nProlog as well: `program.pl` says how."

_HOLDS = {
    "README.md": "this card",
    "config.json": "what was learned, by which settings and versions",
    "results.json": "its figures",
    "program.txt": "the clause program, each clause with its probability",
    "program.pl": "the same as Prolog",
    "model.safetensors": "networks, and clause weights if there are any",
    "replay.gif": "an episode on a layout that it never trained on",
    "manifest.json": "the SHA-256 of every file",
}
