"""What no file of the package may use, by the lint."""

import ast
import json
import re
import subprocess
import sys
from typing import Any

from samples import ROOT

BANNED = """\
import pickle
from pickle import loads
import marshal
import shelve
import tarfile
torch.load("x")
torch.save(1, "x")
numpy.load("x")
yaml.load("x")
yaml.load("x", Loader=yaml.CSafeLoader)
yaml.unsafe_load("x")
shutil.unpack_archive("x")
eval("x")
exec("x")
subprocess.run("x", shell=True)
"""
IMPORTS = "import shutil\nimport subprocess\n\nimport numpy\nimport torch\nimport yaml\n\n"


def found(*given: str, text: str | None = None) -> list[dict[str, Any]]:
    """What the project's lint says of security and of banned names."""
    line = [sys.executable, "-m", "ruff", "check", "--output-format", "json", *given]
    done = subprocess.run(line, input=text, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return [finding for finding in json.loads(done.stdout) if re.match(r"S\d|TID", finding["code"] or "")]


def test_nothing_banned_is_in_the_package() -> None:
    assert found("src") == []


def test_each_banned_use_would_be_found() -> None:
    told = found("--stdin-filename", "src/paddlectl/new.py", "-", text=IMPORTS + BANNED)
    first = IMPORTS.count("\n") + 1
    lines = range(first, first + BANNED.count("\n"))
    assert {finding["location"]["row"] for finding in told} >= set(lines)


def test_no_archive_is_unpacked_by_the_names_in_it() -> None:
    for path in (ROOT / "src").rglob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text()))
        names = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        assert not names & {"extract", "extractall"}, path
