"""Bundles: what goes out comes back byte for byte, and nothing else is let in."""

import hashlib
import io
import json
import random
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
import yaml

from paddlectl.errors import IntegrityError, NotFoundError, PaddlectlError, UsageError
from paddlectl.logic.syntax import parse_program
from paddlectl.registry.bundles import archive, bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry

ARRAYS = safetensors.numpy.save({"x": np.arange(100.0, dtype=np.float32)})
BUNDLES = Path(__file__).with_name("bundles")
END: dict[str, Any] = {"status": "finished", "frames": 10, "episodes": 2, "seconds": 1.5}
PROGRAM = "0.98 :: gt_key() :- !has_key(agent)\n1e-05 :: gt_door() :- has_key(agent)"


@pytest.fixture
def full(registry: Registry, add: Any) -> Registry:
    add.run(kind="transfer", method="paddle", scenario="A", sources=["policy-7"])
    registry.files.append_rows("run-1", "episodes", [{"order": i} for i in range(50)])
    registry.files.write_document("run-1", "mapping", {"target": "T"})
    add.policy("run-1", checkpoint=ARRAYS, program=PROGRAM, metadata={"atoms": ["has_key(agent)"]})
    registry.finish_run("run-1", results={"final_score": 0.5, "area_under_curve": 1e-7}, **END)
    return registry


@pytest.fixture
def bundle(full: Registry, tmp_path: Path) -> dict[str, bytes]:
    bundles.export(full, "run-1", tmp_path / "run.zip")
    return archive.unpack((tmp_path / "run.zip").read_bytes(), "run.zip")


def take_in(location: Path, path: Path) -> dict[str, Any]:
    return bundles.import_(lambda: Registry.open(location), path)


@pytest.mark.parametrize("name", ["policy-1", "BoxDoor", "run-1"])
def test_export_import_export_is_the_same_byte_for_byte(full: Registry, tmp_path: Path, name: str) -> None:
    one, two = tmp_path / "one.zip", tmp_path / "two.zip"
    bundles.export(full, name, one)
    other = Registry.open(tmp_path / "other")
    other.add_run(
        kind="train", method="hdm", task="T", scenario=None, sources=[], seed=0, settings={}, versions={}
    )  # so that the ids differ
    told = take_in(tmp_path / "other", one)
    assert told == {"run": "run-2", "policy": "policy-1", "known": False}
    bundles.export(other, told["run" if name == "run-1" else "policy"], two)
    assert one.read_bytes() == two.read_bytes()
    assert take_in(tmp_path / "other", one) == {"run": "run-2", "policy": "policy-1", "known": True}
    assert other.run("run-2").sources == ("elsewhere:policy-7",)
    assert other.read_checkpoint(other.policy("policy-1")) == ARRAYS
    assert other.files.read_rows("run-2", "episodes") == (
        [{"order": i} for i in range(50)] if name == "run-1" else []
    )
    assert check(tmp_path / "other", read_data=True).faults == []


def test_a_bundle_is_a_model_folder(bundle: dict[str, bytes]) -> None:
    assert list(bundle) == [
        "README.md", "config.json", "results.json", "program.txt", "program.pl", "model.safetensors",
        "run/episodes.jsonl", "run/mapping.json", "manifest.json",
    ]  # fmt: skip
    _, front, text = bundle["README.md"].decode().split("---\n", 2)
    card = yaml.safe_load(front)
    (model,) = card["model-index"]
    (result,) = model["results"]
    assert result["task"]["type"] == "reinforcement-learning"
    assert result["dataset"]["name"] == "BoxDoor"
    metrics = {metric["type"]: metric["value"] for metric in result["metrics"]}
    assert metrics == {"success_rate": 0.5, "mean_score": 0.4, "mean_length": 30.0, "crispness": 0.9}
    assert all(f"`{name}`" in text for name in bundle)
    assert parse_program(bundle["program.txt"].decode()) == parse_program(PROGRAM)
    assert safetensors.numpy.load(bundle["model.safetensors"])["x"][3] == 3.0
    assert json.loads(bundle["config.json"])["run"]["task"] == "BoxDoor"


GIF = b"GIF89a" + bytes(100)


@pytest.mark.parametrize("name", ["policy-1", "run-1"])
def test_an_episode_of_the_policy_goes_with_it(full: Registry, tmp_path: Path, name: str) -> None:
    one, two = tmp_path / "one.zip", tmp_path / "two.zip"
    bundles.export(full, name, one, lambda policy: GIF + policy.task.encode())
    members = archive.unpack(one.read_bytes(), "one.zip")
    assert members["replay.gif"] == GIF + b"BoxDoor"
    text = members["README.md"].decode()
    assert "](replay.gif)" in text and "| `replay.gif` | an episode" in text
    told = take_in(tmp_path / "other", one)
    other = Registry.open(tmp_path / "other")
    bundles.export(other, told["run" if name == "run-1" else "policy"], two, lambda _: GIF + b"BoxDoor")
    assert one.read_bytes() == two.read_bytes()


def test_the_card_is_as_the_hub_reads_it(bundle: dict[str, bytes]) -> None:
    """The fields that it demands of a model card's metadata, and their kinds."""
    card = yaml.safe_load(bundle["README.md"].decode().split("---\n", 2)[1])
    assert card["library_name"] == "paddlectl" and card["pipeline_tag"] == "reinforcement-learning"
    assert all(isinstance(tag, str) and 0 < len(tag) < 100 for tag in card["tags"])
    for model in card["model-index"]:
        assert model.keys() == {"name", "results"} and isinstance(model["name"], str)
        for result in model["results"]:
            assert result.keys() == {"task", "dataset", "metrics"}
            assert all(isinstance(result[part][field], str) for part in ("task", "dataset")
                       for field in ("type", "name"))  # fmt: skip
            for metric in result["metrics"]:
                assert isinstance(metric["type"], str) and type(metric["value"]) in (int, float)


def test_what_isnt_to_be_exported(full: Registry, add: Any, tmp_path: Path) -> None:
    add.run()
    with pytest.raises(UsageError, match="goes on"):
        bundles.export(full, "run-2", tmp_path / "x.zip")
    with pytest.raises(NotFoundError):
        bundles.export(full, "run-9", tmp_path / "x.zip")
    (tmp_path / "there").write_text("mine")
    with pytest.raises(UsageError, match="there already"):
        bundles.export(full, "run-1", tmp_path / "there")
    assert (tmp_path / "there").read_text() == "mine"
    path = full.folder / "runs/run-1/episodes.jsonl"
    path.write_bytes(path.read_bytes().replace(b"7", b"8"))
    with pytest.raises(IntegrityError, match="SHA-256"):
        bundles.export(full, "run-1", tmp_path / "x.zip")
    assert not (tmp_path / "x.zip").exists()


def test_an_interrupted_run_without_a_policy(registry: Registry, add: Any, tmp_path: Path) -> None:
    add.run()
    registry.finish_run("run-1", results={}, **END | {"status": "interrupted"})
    bundles.export(registry, "run-1", tmp_path / "x.zip")
    assert take_in(tmp_path / "other", tmp_path / "x.zip") == {"run": "run-1", "policy": None, "known": False}
    assert Registry.open(tmp_path / "other").run("run-1").status == "interrupted"


# Hostile ones. `sealed` makes a bundle whose manifest is right for what was put into it.

Members = dict[str, bytes]


def sealed(members: Members) -> bytes:
    members = {name: data for name, data in members.items() if name != "manifest.json"}
    seals = {name: [hashlib.sha256(data).hexdigest(), len(data)] for name, data in members.items()}
    return archive.pack(members | {"manifest.json": json.dumps(seals).encode() + b"\n"})


def raw(entries: list[tuple[Any, bytes]], method: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as out:
        for name, data in entries:
            out.writestr(name, data)
    return file.getvalue()


def config(members: Members, *path: str, value: Any, file: str = "config.json") -> bytes:
    document = json.loads(members[file])
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return sealed(members | {file: json.dumps(document).encode() + b"\n"})


def edited(members: Members, old: bytes, new: bytes, file: str = "config.json") -> bytes:
    assert old in members[file]
    return sealed(members | {file: members[file].replace(old, new)})


def linked(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system, info.external_attr = 3, 0o120777 << 16
    return info


def with_replay(members: Members, data: bytes) -> Members:
    """Behind the model, where it stands."""
    found: Members = {}
    for name, each in members.items():
        found |= {name: each} | ({"replay.gif": data} if name == "model.safetensors" else {})
    return found


PICKLE = b"\x80\x04cos\nsystem\n(S'touch canary'\ntR."
NAMES = [
    "../escape.json", "/tmp/escape.json", "C:\\escape.json", "..\\escape.json", "run/../../escape.json",
    "run/a/b.json", "run/", ".", "run/.hidden.json", "run/episodes.jsonl/x", "README.MD", "readme.md",
    "run/EPISODES.jsonl", "run/x.exe", "run/con.json\0.txt", "a" * 300 + ".json",
    "run/\N{RIGHT-TO-LEFT OVERRIDE}.json",
]  # fmt: skip
HOSTILE: dict[str, Callable[[Members], bytes]] = {
    **{
        f"member {name[:24]!r}": lambda m, name=name: raw([*m.items(), (name, b"{}")])  # type: ignore[misc]
        for name in NAMES
    },
    **{
        f"sealed member {name[:24]!r}": lambda m, name=name: sealed(m | {name: b"{}"})  # type: ignore[misc]
        for name in NAMES if "\0" not in name
    },
    "a link": lambda m: raw([*m.items(), (linked("run/link.json"), b"/etc/passwd")]),
    "a link in a member's place": lambda m: raw(
        [(linked(n) if n == "program.txt" else n, d) for n, d in m.items()]
    ),
    "a member twice": lambda m: raw([*m.items(), ("config.json", m["config.json"])]),
    "deflated": lambda m: raw(list(m.items()), zipfile.ZIP_DEFLATED),
    "a bomb": lambda m: raw([*m.items(), ("run/bomb.json", bytes(50_000_000))], zipfile.ZIP_DEFLATED),
    "a bomb of lzma": lambda m: raw([("config.json", bytes(50_000_000))], zipfile.ZIP_LZMA),
    "a zip in a zip": lambda m: sealed(m | {"model.safetensors": archive.pack(m)}),
    "another order": lambda m: archive.pack(dict(sorted(m.items()))),
    "a member less": lambda m: sealed({n: d for n, d in m.items() if n != "results.json"}),
    "no model": lambda m: sealed({n: d for n, d in m.items() if n != "model.safetensors"}),
    "a replay that is none": lambda m: sealed(with_replay(m, b"<svg/>")),
    "a replay without end": lambda m: sealed(with_replay(m, b"GIF89a" + bytes(bundles.LONGEST_REPLAY))),
    "a replay at another place": lambda m: sealed(m | {"replay.gif": GIF}),
    "no manifest": lambda m: archive.pack({n: d for n, d in m.items() if n != "manifest.json"}),
    "a lying manifest": lambda m: archive.pack(m | {"program.txt": b"1.0 :: gt_door() :- has_key(agent)"}),
    "a manifest of nothing": lambda m: archive.pack(m | {"manifest.json": b"{}\n"}),
    "a manifest a list": lambda m: archive.pack(m | {"manifest.json": b"[]\n"}),
    "a manifest too deep": lambda m: archive.pack(m | {"manifest.json": b"[" * 200_000}),
    "junk before": lambda m: b"junk" + archive.pack(m),
    "junk behind": lambda m: archive.pack(m) + b"junk",
    "a comment": lambda m: archive.pack(m)[:-2] + struct.pack("<H", 4) + b"junk",
    "cut": lambda m: archive.pack(m)[:-30],
    "empty": lambda m: b"",
    "no zip": lambda m: b"PK\x03\x04" + bytes(1000),
    "an empty zip": lambda m: archive.pack({}),
    "a database": lambda m: b"SQLite format 3\0" + bytes(4080),
    "pickle for tensors": lambda m: sealed(m | {"model.safetensors": PICKLE}),
    "tensors empty": lambda m: sealed(m | {"model.safetensors": b""}),
    "a huge header": lambda m: sealed(m | {"model.safetensors": struct.pack("<Q", 2**60) + b"{}"}),
    "tensors that overlap": lambda m: sealed(m | {"model.safetensors": overlapping()}),
    "tensors with junk": lambda m: sealed(m | {"model.safetensors": ARRAYS + b"x"}),
    "another format": lambda m: config(m, "format", value="paddlectl bundle 2"),
    "a field more": lambda m: config(m, "more", value=1),
    "a run's field more": lambda m: config(m, "run", "more", value=1),
    "a path for a task": lambda m: config(m, "run", "task", value="../../etc"),
    "an escape in a task": lambda m: config(m, "run", "task", value="\x1b[2J"),
    "markup in a method": lambda m: config(m, "run", "method", value="[red]hdm[/red]"),
    "HTML in a scenario": lambda m: config(m, "run", "scenario", value="<script>alert(1)</script>"),
    "a formula in a scenario": lambda m: config(m, "run", "scenario", value="=cmd|' /C calc'!A0"),
    "a foreign source": lambda m: config(m, "run", "sources", value=["../policy-1"]),
    "a run that goes on": lambda m: config(m, "run", "status", value="running"),
    "a seed of 400 digits": lambda m: config(m, "run", "seed", value=10**400),
    "a seed of 5000 digits": lambda m: edited(m, b'"seed": 0', b'"seed": ' + b"9" * 5000),
    "a seed true": lambda m: config(m, "run", "seed", value=True),
    "frames below zero": lambda m: config(m, "run", "frames", value=-1),
    "seconds infinite": lambda m: edited(m, b"1.5", b"1e999"),
    "settings a list": lambda m: config(m, "run", "settings", value=[]),
    "settings too deep": lambda m: edited(m, b'{"lanes": 64}', b'{"a":' * 90_000),
    "a key twice": lambda m: edited(m, b'"seed": 0', b'"seed": 0, "seed": 0'),
    "not UTF-8": lambda m: sealed(m | {"config.json": b"\xff\xfe"}),
    "a rate above one": lambda m: config(m, "policy", "success_rate", value=1.5, file="results.json"),
    "a run's rate that is a text": lambda m: config(
        m, "run", "success_rate", value="0.5", file="results.json"
    ),
    "a run's rate above one": lambda m: config(m, "run", "success_rate", value=1.5, file="results.json"),
    "a run's figure that is a list": lambda m: config(m, "run", "new", value=[], file="results.json"),
    "a run's figure that is true": lambda m: config(m, "run", "new", value=True, file="results.json"),
    "a figure of a strange name": lambda m: config(m, "run", "a b", value=0.5, file="results.json"),
    "a rate that is no number": lambda m: edited(m, b"0.5", b"NaN", "results.json"),
    "a program that is none": lambda m: sealed(m | {"program.txt": b"gt_key( :-"}),
    "a program not UTF-8": lambda m: sealed(m | {"program.txt": b"\xff"}),
    "a program too long": lambda m: sealed(m | {"program.txt": b"%" * 1_100_000}),
    "a table no JSON": lambda m: sealed(m | {"run/episodes.jsonl": b"{\n"}),
    "a table torn": lambda m: sealed(m | {"run/episodes.jsonl": b"{}\n{}"}),
    "a document too deep": lambda m: sealed(m | {"run/mapping.json": b"[" * 200_000}),
    "a config too long": lambda m: config(m, "run", "settings", value={"x": "y" * 1_100_000}),
}  # fmt: skip


def overlapping() -> bytes:
    header = json.dumps({n: {"dtype": "F32", "shape": [4], "data_offsets": [0, 16]} for n in "ab"}).encode()
    return struct.pack("<Q", len(header)) + header + bytes(16)


def tree(folder: Path) -> set[tuple[Path, bytes]]:
    return {(path, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


def test_there_are_sixty_hostile_bundles() -> None:
    assert len(HOSTILE) >= 60


def test_the_sound_bundle_itself_is_taken_in(bundle: Members, tmp_path: Path) -> None:
    (tmp_path / "x.zip").write_bytes(sealed(bundle))
    assert take_in(tmp_path / "other", tmp_path / "x.zip")["policy"] == "policy-1"


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_bundle_is_refused_and_leaves_nothing(
    bundle: Members, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.zip").write_bytes(HOSTILE[name](bundle))
    before = tree(tmp_path)
    with pytest.raises(IntegrityError) as caught:
        take_in(tmp_path / "other", tmp_path / "x.zip")
    assert len(str(caught.value).splitlines()) <= 2 and len(str(caught.value)) < 800
    assert tree(tmp_path) == before


@pytest.mark.parametrize("name", ["there isn't", "folder", "pipe"])
def test_what_is_no_file(tmp_path: Path, name: str) -> None:
    import os

    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(PaddlectlError):
        take_in(tmp_path / "other", tmp_path / name)
    assert not (tmp_path / "other").exists()


def test_a_large_file_isnt_even_read(tmp_path: Path) -> None:
    with (tmp_path / "x.zip").open("wb") as file:
        file.truncate(archive.LARGEST + 1)
    with pytest.raises(IntegrityError, match="larger than"):
        take_in(tmp_path / "other", tmp_path / "x.zip")


def mutations(data: bytes, count: int, seed: int) -> Iterator[bytes]:
    dice = random.Random(seed)
    for _ in range(count):
        changed = bytearray(data)
        for _ in range(dice.choice([1, 1, 2, 8])):
            at = dice.randrange(len(changed))
            match dice.randrange(4):
                case 0:
                    changed[at] ^= 1 << dice.randrange(8)
                case 1:
                    del changed[at : at + dice.randrange(1, 40)]
                case 2:
                    changed[at:at] = dice.randbytes(dice.randrange(1, 40))
                case _:
                    other = dice.randrange(len(changed))
                    changed[at : at + 30] = changed[other : other + 30]
        if bytes(changed) != data:
            yield bytes(changed)


def test_any_change_of_a_bundle_is_refused(bundle: Members, tmp_path: Path) -> None:
    data = archive.pack(bundle)
    for number, changed in enumerate(mutations(data, 1000, 5)):
        (tmp_path / "x.zip").write_bytes(changed)
        with pytest.raises(IntegrityError):
            take_in(tmp_path / "other", tmp_path / "x.zip")
        assert number or not (tmp_path / "other").exists()
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("path", sorted(BUNDLES.glob("*.zip")), ids=lambda path: path.stem)
def test_what_a_released_version_exported_is_taken_in_for_ever(path: Path, tmp_path: Path) -> None:
    told = take_in(tmp_path / "registry", path)
    with Registry.open(tmp_path / "registry") as registry:
        run, policy = registry.run(told["run"]), registry.policy(told["policy"])
        assert (run.task, run.method, run.scenario, run.status) == ("BoxDoor", "paddle", "A", "finished")
        assert (policy.success_rate, policy.mean_score, policy.program) == (0.5, 0.4, PROGRAM)
        assert registry.read_checkpoint(policy) == ARRAYS
        assert len(registry.files.read_rows(run.id, "episodes")) == 50
