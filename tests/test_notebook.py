"""docs/paddlectl.ipynb: its cells run one after another, with few frames."""

import json
from pathlib import Path
from typing import Any

import pytest

from samples import ROOT
from trials.runs import small

NOTEBOOK = ROOT / "docs" / "paddlectl.ipynb"
FEW = "frames = 1\n"


def test_the_notebook_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PADDLECTL_REGISTRY", raising=False)
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell.get("outputs") for cell in notebook["cells"]), "it is kept without outputs"
    assert sum("frames = 20_000\n" in cell for cell in cells) == 1
    names: dict[str, Any] = {}
    with small():
        for cell in cells:
            exec(compile(cell.replace("frames = 20_000\n", FEW), str(NOTEBOOK), "exec"), names)
    assert [row["kind"] for row in names["runs"]] == ["transfer", "train", "train"]
    assert names["done"] and (tmp_path / "registry").is_dir()
    assert ":-" in capsys.readouterr().out
