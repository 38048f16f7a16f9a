"""Scenarios and studies that are shipped: found by name, the same as by their files, and files come first."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import paddlectl
from paddlectl import shipped
from paddlectl.errors import InvalidFileError, NotFoundError, UsageError
from paddlectl.scenario import load_scenario
from paddlectl.studies.cells import cells_of
from paddlectl.studies.study import load_study
from samples import ROOT

FILES = {path.relative_to(ROOT / "scenarios").with_suffix("").as_posix(): path
         for path in (ROOT / "scenarios").rglob("*.yaml")}  # fmt: skip


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_file_is_shipped_by_its_name() -> None:
    found = {name: shipped.scenario(name) for name in shipped.scenarios()}
    found |= {name: shipped.study(name) for name in shipped.studies()}
    assert found.keys() == FILES.keys()
    assert all(found[name].read_bytes() == FILES[name].read_bytes() for name in FILES)


def test_cells_are_the_same_wherever_their_files_are() -> None:
    named, by_path = (load_study(path) for path in (shipped.study("paper/fig6b"), FILES["paper/fig6b"]))
    assert named[1:] == by_path[1:]
    cells, others = (cells_of(loaded, [0]) for loaded in (named, by_path))
    assert [cell.identity for cell in cells] == [cell.identity for cell in others]


def test_a_file_that_is_there_comes_first(elsewhere: Path) -> None:
    (elsewhere / "A").write_text("name: mine\ntarget: BoxDoor\nsources: [OpenGoal]\n")
    assert load_scenario(shipped.scenario("A")).name == "mine"
    (elsewhere / "paper").mkdir()
    (elsewhere / "paper" / "fig4").write_text("name: own\nscenarios: [A]\nmethods: [hdm]\nseeds: 0\n")
    assert shipped.study("paper/fig4") == Path("paper/fig4")
    (elsewhere / "maze").mkdir()
    assert load_scenario(shipped.scenario("maze")).name == "maze", "a folder is no scenario"


def test_a_study_of_ones_own_names_what_is_shipped(elsewhere: Path) -> None:
    (elsewhere / "sub").mkdir()
    study = elsewhere / "sub" / "study.yaml"
    study.write_text("name: s\nscenarios: [A, minigrid/KeyCorridor]\nmethods: [hdm]\nseeds: 0\n")
    assert [each.name for each in load_study(study).scenarios] == ["A", "KeyCorridor"]
    shutil.copy(FILES["C"], elsewhere / "sub" / "A")
    assert [each.name for each in load_study(study).scenarios] == ["C", "KeyCorridor"]
    study.write_text("name: s\nscenarios: [A-plaec]\nmethods: [hdm]\nseeds: 0\n")
    with pytest.raises(InvalidFileError, match=r"2:13: no file A-plaec, .*; did you mean A-place"):
        load_study(study)


@pytest.mark.parametrize(
    ("found", "text", "kind", "told"),
    [
        (shipped.scenario, "a", NotFoundError, "no file a, and no scenario of that name is shipped\n.* A?"),
        (shipped.scenario, "a-plac", NotFoundError, r"did you mean A-place\b"),
        (shipped.scenario, "keycorridor", NotFoundError, r"did you mean minigrid/KeyCorridor\?"),
        (shipped.scenario, "E", NotFoundError, "there are A, A-place, B,"),
        (shipped.scenario, "scenarios/A.yaml", NotFoundError, r"did you mean A\?"),
        (shipped.scenario, "maze.yaml", NotFoundError, r"did you mean maze\?"),
        (shipped.scenario, "./A", NotFoundError, r"did you mean A\?"),
        (shipped.scenario, "mine", NotFoundError, r"did you mean mine.yaml\?"),
        (shipped.scenario, "../scenarios/paper/fig4", NotFoundError, "no file"),
        (shipped.scenario, "A\nB", NotFoundError, "no file 'A"),
        (shipped.scenario, "A\0", NotFoundError, "no file 'A"),
        (shipped.scenario, "paper/fig4", UsageError, "run: paddlectl sweep paper/fig4 --dry-run"),
        (shipped.study, "fig4", NotFoundError, "did you mean paper/fig4"),
        (shipped.study, "quantum", NotFoundError, "there are paper/ablation-paper"),
        (shipped.study, "A", UsageError, "A is a scenario, not a study"),
    ],
)
def test_what_isnt_shipped_is_told_with_the_nearest_names(
    found: Callable[[str], Path], text: str, kind: type[Exception], told: str, elsewhere: Path
) -> None:
    (elsewhere / "mine.yaml").touch()
    with pytest.raises(kind, match=told) as caught:
        found(text)
    assert len(str(caught.value).splitlines()) <= 2


def test_python_takes_a_name(elsewhere: Path) -> None:
    with pytest.raises(NotFoundError, match="paddlectl train BlockedDoor GapBall"):
        paddlectl.transfer("A", registry=str(elsewhere / "none"))
    with pytest.raises(NotFoundError, match="did you mean A-place"):
        paddlectl.transfer("A-plaec")
