"""Scenario files: what is read, and where and how every mistake is told."""

import json
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl import whole
from paddlectl.errors import InvalidFileError, NotFoundError
from paddlectl.registry.fields import SEEDS
from paddlectl.scenario import Guidance, Scenario, Similarity, TaskSources, load_scenario
from samples import ROOT, TARGET
from samples import SCENARIO as GOOD


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "x.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder: Path, text: str | bytes) -> str:
    path = write(folder, text)
    with pytest.raises(InvalidFileError) as caught:
        load_scenario(path)
    assert "\n" not in caught.value.message
    return caught.value.message.removeprefix(f"{path}:")


def test_a_scenario(tmp_path: Path) -> None:
    assert load_scenario(write(tmp_path, GOOD)) == Scenario(
        name="A",
        target="BlockedBoxUnlockPickup",
        sources=("BlockedDoor", "GapBall"),
        seeds=(0, 1, 2),
        frames=400_000,
        similarity=Similarity(body_weight=0.8, head_weight=0.2),
        guidance=Guidance(mode="default"),
    )


def test_defaults_and_block_style(tmp_path: Path) -> None:
    text = 'name: "0100"  # a text, as written\ntarget: DoorBall\nsources:\n  - DoorBall\n'
    found = load_scenario(write(tmp_path, text))
    assert found == Scenario(name="0100", target="DoorBall", sources=("DoorBall",))
    assert (found.method, found.seeds, found.frames) == ("paddle", (0,), 400_000)
    assert found.similarity == Similarity(body_weight=0.8, head_weight=0.2)


@pytest.mark.parametrize(
    "target, suffix", [("BlockedBoxUnlockPickup", ""), ("BlockedBoxPlaceGoal", "-place")]
)
@pytest.mark.parametrize(
    "letter, second", [("A", "GapBall"), ("B", "DoorBall"), ("C", "BoxDoor"), ("D", "OpenGoal")]
)
def test_the_papers_scenarios(letter: str, second: str, target: str, suffix: str) -> None:
    found = load_scenario(ROOT / "scenarios" / f"{letter}{suffix}.yaml")
    assert (found.name, found.target) == (letter + suffix, target)
    assert found.sources == ("BlockedDoor", second)
    assert (found.seeds, found.frames, found.method) == ((0, 1, 2, 3, 4, 5), 400_000, "paddle")


MISTAKES = [
    # (text to replace, with what, what is told from the position on)
    ("target:", "targt:", "2:1: unknown key 'targt'; did you mean 'target'?"),
    ("target: BlockedBoxUnlockPickup\n", "", "1:1: missing key 'target'"),
    ("GapBall", "GapBal", "3:24: unknown task 'GapBal'; did you mean 'GapBall'?"),
    ("GapBall", "gapball", "3:24: unknown task 'gapball'; did you mean 'GapBall'?"),
    ("GapBall", "BlockedDoor", "3:24: 'BlockedDoor' stands twice in sources"),
    ("paddle", "padle", "4:9: unknown method 'padle'; did you mean 'paddle'?"),
    ("paddle", "dqn", "4:9: unknown method 'dqn'; did you mean 'hdqn'?"),
    ("[0, 1, 2]", "[0, 1, 1]", "5:15: 1 stands twice in seeds"),
    ("[0, 1, 2]", "[0, -1]", "5:12: seeds.1: input should be greater than or equal to 0"),
    ("[0, 1, 2]", "[]", "5:8: seeds: must not be empty"),
    ("[0, 1, 2]", "{0: 1}", "5:9: a key must be a plain text"),
    ("[0, 1, 2]", "null", "5:8: seeds: must be a list"),
    ("[0, 1, 2]", "[true]", "5:9: seeds.0: must be a whole number"),
    ("400000", "0", "6:9: frames: input should be greater than 0"),
    ("400000", "4.5", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", "4e-1", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", "1e20", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", "400000.0000000000000001", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", '"400000"', "6:9: frames: must be a whole number; write 400000"),
    ("400000", '"4e5"', "6:9: frames: must be a whole number; write 400000"),
    ("400000", "400k", "6:9: frames: must be a whole number; write 400000"),
    ("400000", "0.4M", "6:9: frames: must be a whole number; write 400000"),
    ("400000", "400,000", "6:9: frames: must be a whole number; write 400000"),
    ("400000", "400 000", "6:9: frames: must be a whole number; write 400000"),
    ("400000", "400_000", "6:9: frames: must be a whole number; write 400000"),
    ("400000", "\u0664\u0660", "6:9: frames: must be a whole number; write 40"),
    ("400000", "010", "6:9: frames: must be a whole number; write 10"),
    ("400000", "1:30", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", "yes", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", "true", "6:9: frames: must be a whole number; write it in digits"),
    ("400000", ".inf", "6:9: frames: must be a whole number; write it in digits"),
    ("[0, 1, 2]", "0..5", "5:8: not seeds: '0..5'; write 0-5"),
    ("[0, 1, 2]", "0 to 5", "5:8: not seeds: '0 to 5'; write 0-5"),
    ("[0, 1, 2]", "0\u20135", "5:8: not seeds: '0\u20135'; write 0-5"),
    ("[0, 1, 2]", "0:5", "5:8: not seeds: '0:5'; write 0-5"),
    ("[0, 1, 2]", '"[0, 3, 7]"', "5:8: not seeds: '[0, 3, 7]'; write 0,3,7"),
    ("[0, 1, 2]", "0 3 7", "5:8: not seeds: '0 3 7'; write 0,3,7"),
    ("[0, 1, 2]", "yes", "5:8: not seeds: 'yes'; write them as 0-5 or 0,3,7"),
    ("[0, 1, 2]", "0-5,3", "5:8: a seed stands twice in '0-5,3'; write it once"),
    ("[0, 1, 2]", "5-0", "5:8: not seeds: '5-0'; the lower one first"),
    ("[0, 1, 2]", "-1", "5:8: not seeds: '-1'"),
    ("[0, 1, 2]", "[0-5, 7]", "5:9: seeds.0: must be a whole number; write seeds: 0-5, without brackets"),
    ("[0, 1, 2]", '["3"]', "5:9: seeds.0: must be a whole number; write 3"),
    ("[BlockedDoor, GapBall]", "GapBall", "3:10: sources: must be a list; write [GapBall]"),
    ("name: A", "name: 7.0", '1:7: name: must be a text; write "7.0"'),
    ("name: A", "name: true", '1:7: name: must be a text; write "true"'),
    ("0.8", '"0.8"', "7:27: similarity.body_weight: must be a number; write 0.8"),
    ("0.8", "80%", "7:27: similarity.body_weight: must be a number; write 0.8"),
    ("0.8", "yes", "7:27: similarity.body_weight: must be a number; write it in digits, as 0.8"),
    ("{mode: default}", "paper", "8:11: guidance: must be a mapping of keys to values; write {mode: paper}"),
    ("400000", "9" * 5000, "6:9: a number of more than 18 digits"),
    ("400000", "&x 400000", "6:9: anchors and aliases aren't allowed; write the value out"),
    ("400000", "*x", "6:9: anchors and aliases aren't allowed; write the value out"),
    ("400000", "!!int 400000", "6:9: tags aren't allowed: 'tag:yaml.org,2002:int'"),
    ("name: A", "name: !!python/object:os.system A", "1:7: tags aren't allowed: 'tag:yaml.org,2002:python"),
    ("name: A", "name: [red]", "1:7: name: must be a text"),
    ("name: A", "name: ../../etc", "1:7: name: may hold letters, digits, spaces and _ . , + - only"),
    ("frames: 400000", "seeds: [4]", "6:1: key 'seeds' stands twice"),
    ("frames: 400000", "1: 2", "6:1: a key must be a plain text"),
    ("frames: 400000", "<<: {a: 1}", "6:1: unknown key '<<'"),
    ("0.8", ".nan", "7:27: similarity.body_weight: must be a number"),
    ("0.8", ".inf", "7:27: similarity.body_weight: must be a number"),
    ("0.8", "1e999", "7:27: a number too large to hold"),
    ("0.8", "1.2", "7:27: similarity.body_weight: input should be less than or equal to 1"),
    ("0.8", "0.7", "7:13: body_weight and head_weight must add up to 1"),
    ("body_weight", "bodyweight", "7:14: unknown key 'bodyweight'; did you mean 'body_weight'?"),
    ("{mode: default}", "{mode: papr}", "8:18: guidance.mode: input should be 'default' or 'paper'"),
    ("{mode: default}", "{mode: paper, normalise: clp}", "8:36: guidance.normalise: input should be 'clip'"),
    ("{mode: default}", "{mode: paper, num_envs: 0}", "8:35: guidance.num_envs: input should be greater"),
    ("{mode: default}", "{values: per_guide}", "8:11: values is a reading of the paper: add mode: paper"),
    ("{mode: default}", "default", "8:11: guidance: must be a mapping of keys to values"),
    ("{mode: default}", "{mode: default", "9:1: not YAML: did not find expected ',' or '}'"),
    ("{mode: default}", "{mode: default}\n---\nname: B", "9:1: a second document"),
    ("{mode: default}", "\tdefault", "8:12: guidance: must be a mapping"),
    ("name: A", "name: A\x07", "1:8: a character that YAML doesn't allow"),
]  # fmt: skip


@pytest.mark.parametrize("old, new, told", MISTAKES, ids=[told[:60] for _, _, told in MISTAKES])
def test_a_mistake_is_told_with_its_place(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert GOOD.count(old) >= 1
    assert refusal(tmp_path, GOOD.replace(old, new, 1)).startswith(told)


SOURCES = [
    # (what sources: holds, what is told from the position on)
    ("[policy-7, GapBal]", "3:21: unknown task 'GapBal'; did you mean 'GapBall'?"),
    ("[Policy-7]", "3:11: unknown policy 'Policy-7'; did you mean 'policy-7'?"),
    ("[GapBall, policy7]", "3:20: unknown policy 'policy7'; did you mean 'policy-7'?"),
    ("[policy_007]", "3:11: unknown policy 'policy_007'; did you mean 'policy-7'?"),
    ("['7']", "3:11: unknown policy '7'; did you mean 'policy-7'?"),
    ("[7]", "3:11: sources.0: must be a text; write policy-7"),
    ("[0]", "3:11: sources.0: must be a text"),
    ("[policy-0]", "3:11: unknown policy 'policy-0'; ids look like policy-7"),
    ("[policy-1234567890123456789]", "3:11: unknown policy 'policy-1234567890123456789'; ids look like"),
    ("[run-7]", "3:11: unknown policy 'run-7'; ids look like policy-7"),
    ("[policy-7, GapBall, policy-7]", "3:30: 'policy-7' stands twice in sources"),
    ("[MailMaze, policy-7]", f"3:11: MailMaze is a task of maze2d, the target {TARGET} of minigrid: its"),
    ("policy-7", "3:10: sources: must be a list; write [policy-7]"),
    ("paired", "3:10: sources: must be a list; write {tasks: [BlockedDoor, GapBall], seed: paired}"),
    ("[GapBall, {seed: paired}]", "3:20: sources.1: must be a text"),
    ("{}", "3:10: missing key 'tasks'"),
    ("{seed: paired}", "3:10: missing key 'tasks'"),
    ("{task: [GapBall]}", "3:11: unknown key 'task'; did you mean 'tasks'?"),
    ("{mapping: 1, tasks: [GapBall]}", "3:11: unknown key 'mapping'; there are tasks, seed"),
    ("{tasks: [GapBall], seeds: paired}", "3:29: unknown key 'seeds'; did you mean 'seed'?"),
    ("{tasks: [GapBall], seed: paired, seed: best}", "3:43: key 'seed' stands twice"),
    ("{tasks: []}", "3:18: sources.tasks: must not be empty"),
    ("{tasks: GapBall}", "3:18: sources.tasks: must be a list; write [GapBall]"),
    ("{tasks: {GapBall: 1}}", "3:18: sources.tasks: must be a list"),
    ("{tasks: [GapBall, 7]}", "3:28: sources.tasks.1: must be a text"),
    ("{tasks: [GapBall, gapbal]}", "3:28: unknown task 'gapbal'; did you mean 'GapBall'?"),
    ("{tasks: [GapBall, GapBall]}", "3:28: 'GapBall' stands twice in sources.tasks"),
    ("{tasks: [GapBall, MailMaze]}", "3:28: MailMaze is a task of maze2d"),
    ("{tasks: [policy-7], seed: paired}", "3:19: policy-7 is no task; to name policies write sources: [pol"),
    ("{tasks: [GapBall], seed: 3}", "3:35: sources.seed: input should be 'best' or 'paired'"),
    ("{tasks: [GapBall], seed: Paired}", "3:35: sources.seed: input should be 'best' or 'paired'"),
    ("{tasks: [GapBall], seed: [paired]}", "3:35: sources.seed: input should be 'best' or 'paired'"),
    ("{tasks: [GapBall], seed: null}", "3:35: sources.seed: input should be 'best' or 'paired'"),
    ("\n  tasks:\n    - GapBall\n    - GapBal\n  seed: paired", "6:7: unknown task 'GapBal'"),
    ("{auto: 0}", "3:17: sources.auto: input should be greater than or equal to 1"),
    ("{auto: 2.5}", "3:17: sources.auto: must be a whole number"),
    ("{auto: three}", "3:17: sources.auto: must be a whole number"),
    ("{auto: 3, tasks: [GapBall]}", "3:10: auto chooses, tasks are named: leave out one of them"),
    ("{auto: 3, sed: paired}", "3:20: unknown key 'sed'; did you mean 'seed'?"),
    ("{aut: 3}", "3:11: unknown key 'aut'; did you mean 'auto'?"),
    ("auto", "3:10: sources: must be a list; write {auto: 3}"),
    ("\n  tasks:\n    - GapBall\n  seed: pared", "6:9: sources.seed: input should be"),
]


@pytest.mark.parametrize("sources, told", SOURCES, ids=[told[:60] for _, told in SOURCES])
def test_a_mistake_in_the_sources_is_told_with_its_place(tmp_path: Path, sources: str, told: str) -> None:
    assert refusal(tmp_path, GOOD.replace("[BlockedDoor, GapBall]", sources)).startswith(told)


@pytest.mark.parametrize(
    "text, names, paired, stored",
    [
        ("[policy-7, GapBall]", ("policy-7", "GapBall"), False, ["policy-7", "GapBall"]),
        ("{tasks: [GapBall]}", ("GapBall",), False, {"tasks": ["GapBall"], "seed": "best"}),
        ("{auto: 3}", (), False, {"auto": 3, "seed": "best"}),
        ("{auto: 1e0, seed: paired}", (), True, {"auto": 1, "seed": "paired"}),
        ("{seed: best, tasks: [GapBall]}", ("GapBall",), False, {"tasks": ["GapBall"], "seed": "best"}),
        (
            "{tasks: [BoxDoor, GapBall], seed: paired}",
            ("BoxDoor", "GapBall"),
            True,
            {"tasks": ["BoxDoor", "GapBall"], "seed": "paired"},
        ),
    ],
)
def test_sources_are_tasks_and_policies_or_tasks_and_their_seed(
    tmp_path: Path, text: str, names: tuple[str, ...], paired: bool, stored: Any
) -> None:
    found = load_scenario(write(tmp_path, GOOD.replace("[BlockedDoor, GapBall]", text)))
    assert (found.source_names, found.paired) == (names, paired)
    kept = found.model_dump(mode="json")
    assert kept["sources"] == stored
    assert Scenario.model_validate_json(json.dumps(kept)) == found


SOURCE = st.sampled_from(["BlockedDoor", "GapBall", "BoxDoor", "policy-1", "policy-12"])


@given(st.lists(SOURCE, min_size=1, unique=True), st.sampled_from(["best", "paired"]), st.booleans())
def test_what_is_kept_of_a_scenario_gives_it_again(listed: list[str], seed: Any, mapping: bool) -> None:
    sources = TaskSources(tasks=tuple(listed), seed=seed) if mapping else tuple(listed)
    scenario = Scenario(name="A", target="DoorBall", sources=sources)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    assert scenario.source_names == tuple(listed)


NUMBERS = {
    "settings: {num_env: 3}": "9:12: no setting num_env; did you mean num_envs?",
    "settings: {num_envs: 0}": "9:12: num_envs is from 1 to 4096, usually 64",
    "settings: {low_level: {learning_rate: -1e-3}}": "9:24: learning_rate is above 0, usually 0.0005",
    "settings: {low_level: {hidden: []}}": "9:24: hidden is a list of 1 to 16 whole numbers, each from 1 to",
    "settings: {low_level: {hidden: [64, x]}}": "9:24: hidden is a list of whole numbers, usually [",
    "settings: {low_level: 3}": "9:12: low_level is a mapping of ",
    "settings: {frames: 3}": "9:12: frames is of sources alone",
    "settings: num_envs": "9:11: settings: must be a mapping of keys to values",
    "settings:": "9:10: settings: must be a mapping of keys to values",
    "rules: {target_flor: 0}": "9:9: no setting target_flor; did you mean target_floor?",
    "rules: {episodes: always}": "9:9: episodes is one of bandit, guided, alone, usually 'bandit'",
    "rules: {similarity_decay: 1.1}": "9:9: similarity_decay is from 0 to 1, usually 0.7",
    "rule: {}": "9:1: unknown key 'rule'; did you mean 'rules'?",
}


@pytest.mark.parametrize("text", NUMBERS)
def test_a_mistake_in_the_numbers_is_told_with_its_place(tmp_path: Path, text: str) -> None:
    assert refusal(tmp_path, f"{GOOD}{text}\n").startswith(NUMBERS[text])


def test_numbers_of_a_scenario(tmp_path: Path) -> None:
    text = "rules: {target_floor: 0}\nsettings: {low_level: {hidden: [64, 64], clip: 1e-1}, num_envs: 8}\n"
    found = load_scenario(write(tmp_path, GOOD + text))
    assert found.rules == {"target_floor": 0}
    assert found.settings == {"low_level": {"hidden": [64, 64], "clip": 0.1}, "num_envs": 8}
    assert Scenario.model_validate_json(found.model_dump_json()) == found
    older = {k: v for k, v in found.model_dump(mode="json").items() if k not in ("rules", "settings")}
    assert Scenario.model_validate_json(json.dumps(older)).settings == {}


@pytest.mark.parametrize("text", ["400000", "4e5", "4E+5", "400000.0", "400000.", "+400000", "40000000e-2"])
def test_a_whole_number_in_any_decimal_form(tmp_path: Path, text: str) -> None:
    found = load_scenario(write(tmp_path, GOOD.replace("400000", text)))
    assert found.frames == 400_000 and type(found.frames) is int


@pytest.mark.parametrize(
    "text, seeds",
    [
        ("0-5", (0, 1, 2, 3, 4, 5)),
        ('"0,3,7"', (0, 3, 7)),
        ("0,3,7", (0, 3, 7)),
        ("7, 0-2", (7, 0, 1, 2)),
        ("3", (3,)),
        ("1e1", (10,)),
        ("[1e1, 2.0]", (10, 2)),
    ],
)
def test_seeds_as_on_the_command_line(tmp_path: Path, text: str, seeds: tuple[int, ...]) -> None:
    assert load_scenario(write(tmp_path, GOOD.replace("[0, 1, 2]", text))).seeds == seeds


@given(st.sets(st.integers(0, SEEDS - 1), min_size=1, max_size=20))
def test_seeds_are_told_as_they_are_typed(chosen: set[int]) -> None:
    assert list(whole.seeds(whole.ranges(chosen))) == sorted(chosen)


def test_seeds_in_a_row_are_told_as_a_range() -> None:
    assert [whole.ranges(its) for its in ([3], [2, 0, 1], [7, 0, 1], range(1000))] == [
        "3",
        "0-2",
        "0-1,7",
        "0-999",
    ]


def test_of_two_mistakes_the_first_in_the_file_is_told(tmp_path: Path) -> None:
    assert refusal(tmp_path, GOOD.replace("name: A", "name: 3").replace("400000", "x")).startswith(
        "1:7: name"
    )


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    "text, told",
    [
        ("", "1:1: the file is empty"),
        ("# nothing\n", "1:1: the file is empty"),
        ("just a text", "1:1: a scenario: must be a mapping of keys to values"),
        ("- name: A", "1:1: a scenario: must be a mapping of keys to values"),
        (b"name: \xff", "1:7: not UTF-8 text"),
        ("x" * 1_000_001, "1:1: larger than 1,000,000 bytes; a scenario isn't"),
        ("name: " + "[" * 500_000, "1:"),  # PyYAML from 6.0.4 on reads ahead, and says so itself
        ("name: " + "{a: " * 100_000, "1:68: nested deeper than 16 levels"),
        ("name: [" + "1," * 400_000 + "]", "1:20002: more than 10,000 values; a scenario has fewer"),
        (BOMB, "1:4: anchors and aliases aren't allowed; write the value out"),
        ("a: &a [*a]", "1:4: anchors and aliases aren't allowed; write the value out"),
        ('name: "\\ud800"', "1:"),
        ("%YAML 9.9\n---\nname: A", "1:1: not YAML"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_hostile_files_are_refused_quickly(tmp_path: Path, text: str | bytes, told: str) -> None:
    began = time.process_time()
    assert refusal(tmp_path, text).startswith(told)
    assert time.process_time() - began < 2.0


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    write(tmp_path, GOOD)
    with pytest.raises(NotFoundError) as caught:
        load_scenario(tmp_path / "y.yaml")
    assert caught.value.message == f"no file {tmp_path / 'y.yaml'}"
    assert caught.value.hint == f"did you mean {tmp_path / 'x.yaml'}?"
    with pytest.raises(InvalidFileError, match="not a file"):
        load_scenario(tmp_path)


def test_links_that_lead_to_no_file(tmp_path: Path) -> None:
    loop, lost = tmp_path / "loop.yaml", tmp_path / "lost.yaml"
    loop.symlink_to(loop)
    lost.symlink_to(tmp_path / "gone.yaml")
    (tmp_path / "x").symlink_to(tmp_path / "x")
    for path, told in (
        (loop, "symbolic links that lead in a circle"),
        (tmp_path / "x" / "a.yaml", "symbolic links that lead in a circle"),
        (lost, f"{lost} is a link to {tmp_path / 'gone.yaml'}, where no file is"),
    ):
        with pytest.raises(NotFoundError) as caught:
            load_scenario(path)
        assert told in caught.value.message and "did you mean" not in caught.value.hint
    with pytest.raises(NotFoundError) as caught:
        load_scenario(tmp_path / "los.yaml")
    assert caught.value.hint == ""


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_mutated_file_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    sources = data.draw(st.sampled_from(["[BlockedDoor, policy-7]", "{tasks: [GapBall], seed: paired}"]))
    text = bytearray(GOOD.replace("[BlockedDoor, GapBall]", sources).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(text) - 1))
        text[place : place + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = write(tmp_path_factory.getbasetemp(), bytes(text))
    try:
        assert isinstance(load_scenario(path), Scenario)
    except InvalidFileError as error:
        place, _, _ = error.message.removeprefix(f"{path}:").partition(": ")
        line, column = place.split(":")
        assert int(line) >= 1 and int(column) >= 1
