"""Study files: what is read, and where and how every mistake is told."""

from pathlib import Path

import pytest

from paddlectl.errors import InvalidFileError, NotFoundError
from paddlectl.scenario import Guidance, Similarity
from paddlectl.studies.study import Variant, load_study, varied
from samples import ROOT

A, C, MAZE = (ROOT / "scenarios" / f"{name}.yaml" for name in ("A", "C", "maze"))
GOOD = f"name: mine\nscenarios: [{A}, {C}]\nmethods: [paddle, hdm]\nseeds: 0-1\n"


def refusal(folder: Path, text: str) -> str:
    path = folder / "x.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError) as caught:
        load_study(path)
    assert "\n" not in caught.value.message
    return caught.value.message.removeprefix(f"{path}:")


def test_a_study_reads_its_scenarios_from_where_it_is(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "one.yaml").write_text("name: one\ntarget: BoxDoor\nsources: [OpenGoal]\n")
    path = tmp_path / "sub" / "study.yaml"
    path.write_text("name: s\nscenarios: [../one.yaml]\nmethods: [hdm]\nseeds: [3, 5]\n")
    loaded = load_study(path)
    assert (loaded.study.seeds, loaded.study.frames, loaded.study.figure) == ((3, 5), None, "curves")
    assert [scenario.name for scenario in loaded.scenarios] == ["one"]


STUDIES = [
    path for path in (ROOT / "scenarios" / "paper").glob("*.yaml") if path.stem not in ("quantity", "library")
]


@pytest.mark.parametrize("path", sorted(STUDIES), ids=lambda path: path.stem)
def test_the_papers_studies_have_six_seeds(path: Path) -> None:
    loaded = load_study(path)
    assert loaded.study.name == path.stem
    assert loaded.study.seeds == tuple(range(6))


def test_what_a_variant_changes() -> None:
    scenario = load_study(ROOT / "scenarios" / "paper" / "fig4.yaml").scenarios[0]
    same = varied(scenario, Variant())
    assert same.paired and same.source_names == scenario.source_names
    variant = Variant(
        sources=("OpenGoal",),
        similarity=Similarity(body_weight=1.0, head_weight=0.0),
        guidance=Guidance(mode="paper"),
    )
    other = varied(scenario, variant)
    assert other.source_names == ("OpenGoal",) and other.name == scenario.name
    assert (other.similarity.body_weight, other.guidance.mode) == (1.0, "paper")


MISTAKES = {
    "methods: [ppo, hdm]\nseeds: 0-999\nvariants: {" + ", ".join(f"v{n}: {{}}" for n in range(51)) + "}": (
        "4:8: 204,000 cells in all; a study has 100,000 at most"
    ),
    "methods: [padle]": "3:11: unknown method 'padle'; did you mean 'paddle'?",
    "methods: [paddle, paddle]": "3:19: 'paddle' stands twice in methods",
    "methods: paddle": "3:10: methods: must be a list; write [paddle]",
    "methods: []": "3:10: methods: must not be empty",
    "methods: [componet]\nfigure: curve": "4:9: figure: input should be 'curves' or 'weights'",
    "methods: [hdm]\nvariant: {}": "4:1: unknown key 'variant'; did you mean 'variants'?",
    "methods: [hdm]\nframes: 4k": "4:9: frames: must be a whole number; write 4000",
    "methods: [hdm]\nseeds: [0-5]": "4:9: seeds.0: must be a whole number; write seeds: 0-5",
    "methods: [paddle]\nvariants: {v: {rule: {}}}": "4:16: unknown key 'rule'; did you mean 'rules'?",
    "methods: [paddle]\nvariants: {v: {methods: [hdm]}}": "4:26: unknown method 'hdm'; there are paddle",
    "methods: [paddle]\nvariants: {v: {rules: {floor: 0}}}": "4:24: paddle: no setting floor; there are: ",
    "methods: [paddle]\nvariants: {v: {rules: {target_flor: 0}}}": (
        "4:24: paddle: no setting target_flor; did you mean target_floor? or there are: "
    ),
    "methods: [paddle]\nvariants: {v: {rules: {target_floor: no}}}": (
        "4:24: paddle: target_floor is a number, usually 0.05"
    ),
    "methods: [hdm]\nvariants: {v: {settings: {num_envs: 2.5}}}": "4:27: hdm: num_envs is a whole number",
    "methods: [hdm]\nvariants: {v: {rules: {episodes: 3}}}": "4:24: hdm: no setting episodes; it has none",
    "methods: [hdm]\nvariants: {v: {settings: {low_level: 3}}}": "4:27: hdm: low_level is a mapping of ",
    "methods: [cup]\nvariants: {v: {settings: {learner: {rate: 3}}}}": "4:37: cup: no setting rate; there ",
    "methods: [cup]\nvariants: {v: {random: [BoxDoor]}}": "4:24: cup can't reuse those; say for which",
    "methods: [paddle]\nvariants: {v: {random: [BoxDor]}}": "4:25: unknown task 'BoxDor'; did you mean",
    "methods: [paddle]\nvariants: {v: {sources: [MailMaze]}}": "4:26: MailMaze is a task of maze2d, ",
    "methods: [paddle]\nvariants: {v: {similarity: {body_weight: 1}}}": (
        "4:28: body_weight and head_weight must add up to 1"
    ),
    "methods: [paddle]\nvariants: {a/b: {}}": "4:12: variants.a/b: may hold letters, digits, spaces and ",
    "methods: [paddle]\nvariants: {'': {}}": "4:12: variants.: string should have at least 1 character",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_told_with_its_place(text: str, tmp_path: Path) -> None:
    head = f"name: mine\nscenarios: [{A}, {C}]\n"
    seeds = "" if "seeds" in text else "\nseeds: 0"
    assert refusal(tmp_path, head + text + seeds).startswith(MISTAKES[text])


def test_files_of_scenarios_that_cant_be_used(tmp_path: Path) -> None:
    def with_scenarios(names: str, methods: str = "paddle") -> str:
        return f"name: mine\nseeds: 0\nmethods: [{methods}]\nscenarios: [{names}]\n"

    assert refusal(tmp_path, with_scenarios("none.yaml")).startswith(f"4:13: no file {tmp_path}/none.yaml")
    (tmp_path / "bad.yaml").write_text("name: bad\ntarget: BoxDor\nsources: [GapBall]\n")
    assert refusal(tmp_path, with_scenarios(f"{A}, bad.yaml")).startswith(
        f"4:{15 + len(str(A))}: {tmp_path}/bad.yaml:2:9: unknown task 'BoxDor'"
    )
    (tmp_path / "again.yaml").write_text("name: A\ntarget: BoxDoor\nsources: [GapBall]\n")
    assert "another scenario before is called 'A', too" in refusal(
        tmp_path, with_scenarios(f"{A}, again.yaml")
    )
    (tmp_path / "named.yaml").write_text("name: B\ntarget: BoxDoor\nsources: [policy-3]\n")
    assert "it reuses policy-3" in refusal(tmp_path, with_scenarios("named.yaml"))
    assert "componet chooses discrete actions" in refusal(tmp_path, with_scenarios(str(MAZE), "componet"))


def test_a_study_that_isnt_there(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(GOOD)
    with pytest.raises(NotFoundError) as caught:
        load_study(tmp_path / "studdy.yaml")
    assert "study.yaml" in (caught.value.hint or "")
