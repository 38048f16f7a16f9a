"""README and docs/ say what is so: their commands can be typed, and their links lead somewhere."""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.main

from paddlectl.cli.app import COMMANDS, make_app
from samples import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^(?:```(?:sh)?\n(.*?)^```|((?: {4}\S.*\n)+))", re.DOTALL | re.MULTILINE)
WORDS = 1_300


def lines(page: Path) -> Iterator[str]:
    """The command lines of a page's blocks."""
    for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
        for line in (block[1] or block[2]).splitlines():
            line = line.strip().removeprefix("$ ")
            if line.startswith("paddlectl "):
                yield line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_its_commands_can_be_typed(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("cab.py", "detour.py"):
        (tmp_path / name).write_text("TASKS = {'Own': print}")
    app = typer.main.get_command(make_app(COMMANDS))
    for line in lines(page):
        words = shlex.split(line, comments=True)[1:]
        context = app.make_context("paddlectl", ["--help"], resilient_parsing=True)
        command = app
        while hasattr(command, "get_command"):
            found = command.get_command(context, words[0])
            assert found is not None or words[0].startswith("-"), line
            if found is None:
                break
            command, words = found, words[1:]
        else:
            if "--tasks" not in words:
                command.make_context(str(command.name), words, parent=context)


def test_there_are_commands_to_check() -> None:
    assert len([line for page in PAGES for line in lines(page)]) > 20


def test_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len([word for word in text.split() if any(map(str.isalpha, word))]) < WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_its_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = target.partition("#")
        assert "://" not in file, "nothing is on another host"
        other = page.parent / file if file else page
        assert other.exists(), target
        assert not anchor or anchor in anchors(other), target


def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub and MkDocs make them."""
    found = re.findall(r"^#+ (.*)", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


@pytest.mark.skipif(
    not shutil.which("mkdocs", path=str(Path(sys.executable).parent)), reason="without mkdocs"
)
def test_the_site_is_built(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "tutorial" / "index.html").exists()


def test_pages_that_scripts_write_are_as_they_write_them(tmp_path: Path) -> None:
    """Of docs/fields.py the tests of `--json` say so."""
    before = {page: page.read_bytes() for page in PAGES}
    copy = tmp_path / "copy"
    for folder in ("benchmarks", "docs", "scenarios"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "README.md", copy)
    for script in ("benchmarks/tables.py", "benchmarks/paper.py", "docs/settings.py"):
        line = [sys.executable, str(copy / script)]
        subprocess.run(line, check=True, timeout=60, capture_output=True)
    for page, text in before.items():
        assert (copy / page.relative_to(ROOT)).read_bytes() == text, page.name
