"""`watch`: a GIF of an episode with its subgoals, and the same in a terminal."""

import gzip
import io
import os
import pty
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from paddlectl.cli.watch import thinned
from paddlectl.experiments.runner import random_source
from paddlectl.experiments.watching import watched
from paddlectl.methods.base import method_of
from paddlectl.registry.bundles import archive, bundles
from paddlectl.registry.store import Registry
from paddlectl.report import replay
from paddlectl.report.frames import LAST, blocks, gif
from paddlectl.report.replay import MOST, replay_gif
from paddlectl.tasks.suite import load
from released import BUNDLES
from samples import ROOT, Answer, Command, add_source

RED, BLUE, YELLOW = (255, 0, 0), (0, 0, 255), (255, 255, 0)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with a policy that has learned BoxDoor."""
    folder = tmp_path_factory.mktemp("watch")
    (folder / "BoxDoor.zip").write_bytes(gzip.decompress((BUNDLES / "BoxDoor-0002.zip.gz").read_bytes()))
    bundles.import_(lambda: Registry.open(folder / "registry"), folder / "BoxDoor.zip")
    return folder / "registry"


def watch(command: Command, place: Path, *line: str) -> Answer:
    return command("watch", *line, "--registry", str(place))


def test_a_gif_has_a_picture_for_each_step(place: Path, command: Command, tmp_path: Path) -> None:
    file = tmp_path / "episode.gif"
    told = watch(command, place, "BoxDoor", "--gif", str(file), "--per-second", "10", "--json").json
    assert told["score"] == pytest.approx(1 - 0.9 * told["steps"] / 320) and told["file"] == str(file)
    with Image.open(file) as picture:
        assert picture.n_frames == told["steps"] + 1 and picture.info["duration"] == 100
        picture.seek(picture.n_frames - 1)
        assert picture.info["duration"] == LAST * 100
    again = watch(command, place, "run-1", "--gif", str(tmp_path / "again.gif"))
    end = f"BoxDoor by policy-1, solved, score {told['score']:.2f}, {told['steps']} steps"
    assert " ".join(again.out.split()).endswith(end)
    assert (tmp_path / "again.gif").read_bytes() != file.read_bytes()  # six pictures in a second, not ten


@pytest.mark.parametrize(
    ("task", "method", "subgoals"),
    [
        ("BlockedDoor", "hdqn", True),
        ("GapBall", "ppo", False),
        ("MailMaze", "hdm", True),
        ("MiniGrid-DoorKey-5x5-v0", "hdm", True),
    ],
)
def test_every_kind_of_policy_can_be_watched(task: str, method: str, subgoals: bool) -> None:
    loaded = load(task)
    kind = method_of(method)
    policy = kind.policy(loaded, 0, kind.settings_for(loaded, None))
    seen = watched(policy, task, 3)
    first, second = next(seen), next(seen)
    assert (first.t, second.t, first.ended) == (0, 1, False)
    assert first.picture.shape == second.picture.shape and first.picture.dtype == np.uint8
    assert bool(first.subgoal) == subgoals
    assert first.subgoal in ("", *map(str, loaded.domain_subgoals))


def test_an_unseen_layout_is_played_and_equal_seeds_play_alike(tmp_path: Path) -> None:
    registry = Registry.open(tmp_path / "registry")
    from paddlectl.experiments.policies import revive

    policy = revive(registry, random_source("BoxDoor", 0, registry))
    one, other, third = (
        [moment.picture for moment in watched(policy, "BoxDoor", seed)] for seed in (1, 1, 2)
    )
    assert len(one) == len(other) and all(map(np.array_equal, one, other))
    assert not np.array_equal(one[0], third[0])


def test_a_bundle_shows_an_episode_of_its_policy(place: Path, command: Command, tmp_path: Path) -> None:
    def exported(name: str, registry: Path) -> dict[str, bytes]:
        file = tmp_path / f"{len([*tmp_path.iterdir()])}.zip"
        assert command("registry", "export", name, str(file), "--registry", str(registry)).code == 0
        return archive.unpack(file.read_bytes(), file.name)

    members = exported("BoxDoor", place)
    assert len(members["replay.gif"]) < bundles.LONGEST_REPLAY
    with Image.open(io.BytesIO(members["replay.gif"])) as picture:
        assert 2 < picture.n_frames <= MOST + 1
    assert exported("run-1", place)["replay.gif"] == members["replay.gif"]
    bundles.import_(lambda: Registry.open(tmp_path / "other"), tmp_path / "0.zip")
    assert exported("policy-1", tmp_path / "other") == members


def test_one_that_cant_be_played_has_no_picture(tmp_path: Path) -> None:
    registry = Registry.open(tmp_path / "registry")
    add_source(registry, "BoxDoor", None)
    assert replay_gif(registry, registry.policy("policy-1")) == b""


def test_a_picture_that_would_be_too_large_has_fewer(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    registry = Registry.open(place)
    whole = replay_gif(registry, registry.policy("policy-1"))
    monkeypatch.setattr(replay, "LONGEST_REPLAY", len(whole) - 1)
    fewer = replay_gif(registry, registry.policy("policy-1"))
    assert 0 < len(fewer) < len(whole)
    monkeypatch.setattr(replay, "LONGEST_REPLAY", 1000)
    assert replay_gif(registry, registry.policy("policy-1")) == b""


def test_in_a_terminal_it_is_drawn_with_what_it_goes_for(place: Path) -> None:
    line = [sys.executable, "-m", "paddlectl", "watch", "BoxDoor", "--per-second", "50"]
    own, terminal = pty.openpty()
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "TERM": "xterm-256color", "COLUMNS": "60"}
    environment |= {"COLORTERM": "truecolor", "PYTHONUTF8": "1"}
    process = subprocess.Popen([*line, "--registry", str(place)], stdout=terminal, env=environment)
    os.close(terminal)
    shown = b""
    try:
        while part := os.read(own, 65536):
            shown += part
    except OSError:
        pass  # it has ended
    os.close(own)
    assert process.wait(60) == 0
    text = shown.decode()
    assert "▀" in text and "gt_box()" in text and re.search(r"solved, score 0\.\d\d, \d+ steps", text)


def test_what_cant_be_watched_is_told(place: Path, command: Command, tmp_path: Path) -> None:
    def told(*line: str) -> tuple[int, str]:
        answer = watch(command, place, *line)
        assert answer.out == ""
        return answer.code, answer.err

    gif_at = ("--gif", str(tmp_path / "x.gif"))
    assert told("BoxDoor") == (
        2,
        "error: an episode is played in a terminal\nor written to a file: --gif FILE\n",
    )
    assert told("BoxDoor", "--json")[0] == 2
    assert told("GapBall", *gif_at)[0] == 4
    assert told("run-9", *gif_at)[0] == 4
    assert told("BoxDoor", "--task", "MailMaze", *gif_at)[0] == 5
    assert told("BoxDoor", "--gif", str(tmp_path / "no" / "x.gif"))[0] == 2
    assert told("BoxDoor", "--gif", str(tmp_path))[0] == 2
    code, message = told("BoxDoor", "--gif", str(tmp_path / ("a" * 300 + ".gif")))
    assert code == 2 and "can't be written: File name too long\nname a file elsewhere" in message
    assert "doesn't end in .gif" in told("BoxDoor", "--gif", str(tmp_path / "mine.py"))[1]
    assert list(tmp_path.iterdir()) == []


# The pictures


def halves() -> np.ndarray:
    """Red above, blue below."""
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:4], picture[4:] = RED, BLUE
    return picture


def test_a_character_is_two_points() -> None:
    text = blocks(halves(), 2, "utf-8")
    assert text.plain == "▀▀\n"
    assert {str(span.style) for span in text.spans} == {"#ff0000 on #0000ff"}


def test_where_there_are_no_half_blocks_it_is_one() -> None:
    text = blocks(halves(), 4, "ascii")
    assert text.plain == "    \n    \n"
    assert [str(span.style) for span in text.spans][::4] == ["#ff0000 on #ff0000", "#0000ff on #0000ff"]


def test_a_colour_that_comes_late_and_is_rare_is_shown(tmp_path: Path) -> None:
    dice = np.random.default_rng(0)
    pictures = [dice.integers(60, 190, (40, 40, 1), np.uint8).repeat(3, -1) for _ in range(9)]
    pictures[7][20:22, 20:22] = YELLOW
    file = tmp_path / "x.gif"
    file.write_bytes(gif(pictures, [""] * 9, 5))
    with Image.open(file) as picture:
        picture.seek(7)
        assert picture.convert("RGB").getpixel((20, 20)) == pytest.approx(YELLOW, abs=3)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 399, 400, 401, 1000, 10_007])
def test_however_long_an_episode_is_few_moments_are_kept_and_the_last(count: int) -> None:
    most = 400 if count > 5 else 4
    kept = thinned(iter([*range(count)]), most)  # type: ignore[arg-type]
    assert len(kept) <= most + 1 and kept[0] == 0 and kept[-1] == count - 1
    assert len({after - before for before, after in pairwise(kept[:-1])}) <= 1
    assert len(kept) > min(count, most) / 2


def test_the_captions_stand_below(tmp_path: Path) -> None:
    file = tmp_path / "x.gif"
    file.write_bytes(gif([halves().repeat(10, 1)] * 2, ["", "gt_key()"], 5))
    with Image.open(file) as picture:
        assert picture.n_frames == 2 and picture.size[0] == 80 and picture.size[1] > 8
        assert picture.convert("RGB").getpixel((1, 1)) == RED
