"""The page of an explanation: it has all that is told, asks nothing of a network, and can be read."""

import base64
import hashlib
import html
import io
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from paddlectl.registry.store import Registry
from paddlectl.report import film
from paddlectl.report.explanation import explanation_document
from paddlectl.report.page import _colours, _legend, explanation_page
from paddlectl.report.svg import COLOURS, Line, lines, stacked
from samples import (
    BLOCKED_DOOR,
    GAP_BALL,
    TARGET,
    add_source,
    add_transfer,
    body,
    decision,
    program,
    recording,
    reseal,
)

SIZE = (200, 100)
VOID = {"meta", "br", "line", "polyline", "polygon", "input"}
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    opened = Registry.open(tmp_path / "registry")
    add_source(opened, "BlockedDoor", program("BlockedDoor", BLOCKED_DOOR))
    add_source(opened, "GapBall", program("GapBall", GAP_BALL))
    add_transfer(opened)
    rows = [
        {"order": n, "started": 500 * n, "frames": 500 * n + 400, "score": 0.5, "length": 9, "success": True}
        for n in range(110)
    ]
    opened.files.append_rows("run-3", "episodes", rows)
    moments = [
        {"frames": 6000 * n, "scene": 0, "policy": policy, "similarity": 0.5, "performance": 0.4,
         "weight": 0.45, "chosen": 2}
        for n in range(1, 11) for policy in ("target", "policy-1")
    ]  # fmt: skip
    opened.files.append_rows("run-3", "moments", moments)
    record(opened, recording(TARGET, "gt_blockage()", "gt_key()"))
    return opened


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures, which take long."""
    monkeypatch.setattr(film, "MOST", 17)


def record(opened: Registry, told: dict[str, Any], run: str = "run-3") -> None:
    """Lets the run have recorded that early episode."""
    opened.files.write_document(run, "recordings", {"early": told})
    if opened.run(run).status != "running":
        reseal(opened, run)


def page(registry: Registry, run: str = "run-3") -> str:
    record = registry.run(run)
    return explanation_page(registry, record, explanation_document(registry, record, recorded=False))


class Balanced(HTMLParser):
    """Every element is closed where it was opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.seen.add(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def parsed(text: str) -> Balanced:
    parser = Balanced()
    parser.feed(text)
    parser.close()
    assert parser.open == []
    return parser


def test_it_has_all_parts(registry: Registry) -> None:
    text = page(registry)
    assert parsed(text).seen >= {"svg", "details", "table", "main"}
    for told in (
        "run-3: paddle on BlockedBoxUnlockPickup, seed 0", "jump-start", "0.70", "Learning curve",
        "the decisions were led", "Who led over training", "Ψ: whose logic", "0.562", "Learned program",
        "0.90 <code>gt_blockage()</code>", "subgoal(gt_blockage, 0.9)", "One early episode", "12</td>",
        "its Λ is the largest", "All settings",
    ):  # fmt: skip
        assert told in text, told
    assert text.count("<svg") == 2 and len(text) < 2_000_000


def test_beside_it_stands_the_curve_of_its_base_learner(registry: Registry) -> None:
    assert "from scratch" not in page(registry)
    for method, seed in (("ppo", 0), ("hdm", 5), ("hdm", 0)):
        run = registry.add_run(
            kind="transfer", method=method, task=TARGET, scenario="A", sources=(), seed=seed, settings={},
            versions={},
        ).id  # fmt: skip
        registry.files.append_rows(run, "episodes", registry.files.read_rows("run-3", "episodes"))
        registry.finish_run(run, status="finished", frames=60_000, episodes=1, seconds=1.0, results={})
    assert "hdm from scratch (run-6)" in page(registry)


def test_a_run_that_recorded_little_has_a_page(registry: Registry) -> None:
    run = registry.add_run(
        kind="transfer", method="unheard", task=TARGET, scenario="A", sources=["policy-1"], seed=0,
        settings={}, versions={},
    ).id  # fmt: skip
    text = page(registry, run)
    parsed(text)
    assert "<svg" not in text and "All settings" in text
    rows = [
        {"frames": frames, "context": body(TARGET, "E"), "source": source, "terms": {}, "weight": 0.5,
         "chosen": chosen, "reached": None}
        for frames in (1000, 2000) for source, chosen in (("target", 1), ("policy-1", 3))
    ]  # fmt: skip
    registry.files.append_rows(run, "reuse", rows)
    assert page(registry, run).count("<svg") == 1


def test_nothing_stored_is_taken_for_markup(registry: Registry) -> None:
    evil = "</pre><script>alert(1)</script>"
    run = registry.add_run(
        kind="transfer", method="cup", task=TARGET, scenario="A", sources=["policy-1"], seed=0,
        settings={evil: evil}, versions={"a": evil},
    ).id  # fmt: skip
    registry.files.write_document(run, "start", {evil: evil})
    row = {"frames": 1, "source": "target", "terms": {}, "weight": 0.5, "chosen": 1, "reached": None}
    registry.files.append_rows(run, "reuse", [row | {"context": [evil]}])
    text = page(registry, run)
    assert "script" not in parsed(text).seen and "&lt;script&gt;" in text


def test_it_asks_nothing_of_a_network(registry: Registry) -> None:
    text = page(registry)
    assert not re.search(r"https?:|src=|href=|url\((?!data:image/webp;base64,)|@import|<link|<iframe", text)
    (script,) = re.findall("<script>(.*?)</script>", text, re.S)
    own = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = re.search(r'Security-Policy" content="(.*?)">', text)
    assert policy is not None
    told = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{own}'"
    assert html.unescape(policy[1]) == told


# Recorded episodes


def sheet_of(text: str) -> Image.Image:
    found = re.search(r"url\(data:image/webp;base64,(.*?)\)", text)
    assert found is not None
    return Image.open(io.BytesIO(base64.b64decode(found[1])))


def test_a_recorded_episode_is_a_film(registry: Registry) -> None:
    text = page(registry)
    assert "One early episode, decision by decision: not solved, 320 steps, ended at frame 5,000" in text
    assert (
        'aria-label="An episode as moving pictures: not solved, 320 steps. It goes for gt_blockage()' in text
    )
    assert "a picture each 20 steps" in text
    (frames,) = re.findall(r"@keyframes early \{(.*?)\n\}", text, re.S)
    steps = [int(step) for step in re.findall(r"--step: (\d+);", frames)]
    assert steps == [*range(0, 320, 20), 320]
    assert sheet_of(text).size == (film.COLUMNS * 360, -(-len(steps) // film.COLUMNS) * 192)
    parts = re.findall(r'<p style="--n: (\d+)">(.*?)</p>', text, re.S)
    assert [int(number) for number, _ in parts] == [*range(len(parts))]
    assert "gt_blockage() :- {has_key" not in parts[0][1] and "gt_blockage() :- {" in parts[0][1]
    assert "gt_key() :- {" in parts[-2][1] and "Not solved, 320 steps" in parts[-1][1]
    shown = [int(part) for part in re.findall(r"--part: (\d+);", frames)]
    assert shown == sorted(shown) and shown[0] == 0 and shown[-1] == len(parts) - 1


def test_the_decisions_of_the_same_episode_are_told_with_it(registry: Registry) -> None:
    two = [decision() | {"steps": 100}, decision() | {"guide": "target", "head": "gt_box()", "steps": 220}]
    registry.files.write_document("run-3", "trace", {"early": two, "score_early": 0.0})
    reseal(registry, "run-3")
    text = page(registry)
    parts = re.findall(r'<p style="--n: (\d+)">(.*?)</p>', text, re.S)
    assert "<b>BlockedDoor</b> leads" in parts[0][1] and "gt_blockage() :- {has_key(env), " in parts[0][1]
    assert "<b>the target</b> leads" in parts[1][1] and len(parts) == 3
    (frames,) = re.findall(r"@keyframes early \{(.*?)\n\}", text, re.S)
    assert "--step: 80; --part: 0; --leads: var(--c1)" in frames
    assert "--step: 100; --part: 1; --leads: var(--c0)" in frames
    assert text.count('<tr class="part"') == 2


def test_of_a_method_that_follows_it_tells_whom_mostly(registry: Registry) -> None:
    run = registry.add_run(
        kind="transfer", method="cup", task=TARGET, scenario="A", sources=["policy-1"], seed=0, settings={},
        versions={},
    ).id  # fmt: skip
    record(registry, recording(), run)
    assert "followed most often" not in page(registry, run) and "in <code>{" in page(registry, run)
    rows = [
        {"frames": frames, "context": body(TARGET, "X"), "source": source, "terms": {}, "weight": 0.5,
         "chosen": chosen, "reached": None}
        for frames, led in ((4000, 9), (8000, 1)) for source, chosen in (("target", led), ("policy-1", 3))
    ]  # fmt: skip
    registry.files.append_rows(run, "reuse", rows)
    text = page(registry, run)
    parsed(text)
    assert "<b>BlockedDoor</b> is followed most often here, 75\xa0%" in text
    assert "goes for" not in text


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"score": 0.5}, "an episode of BlockedBoxUnlockPickup comes out otherwise than it was recorded."),
        ({"start": {}}, "comes out otherwise"),
        ({"actions": [9] * 320}, "comes out otherwise"),
        ({"start": {**recording()["start"], "agent": 10**400}}, "comes out otherwise"),
        ({"length": -1}, "Without pictures: recordings.json of run-3"),
    ],
)
def test_one_that_cant_be_played_again_is_told_and_the_rest_stands(
    registry: Registry, change: dict[str, Any], told: str
) -> None:
    record(registry, recording() | change)
    text = page(registry)
    assert told in text and "@keyframes" not in text and "<script" not in text
    assert "12</td>" in text


def test_of_very_many_sources_those_that_led_most_have_a_colour_of_their_own() -> None:
    sources = [f"policy-{number}" for number in range(1, 11)]
    rows = [
        {"frames": 1000, "context": ["a()"], "source": source, "chosen": number}
        for number, source in enumerate(sources)
    ]
    document = {"sources": sources, "mapping": None, "moments": [], "reuse": rows}
    colours = _colours(document)
    own = ["target", *(f"policy-{number}" for number in (10, 9, 8, 7, 6, 5))]
    assert [policy for policy, colour in colours.items() if colour < COLOURS - 1] == own
    assert [colours[policy] for policy in own] == [*range(COLOURS - 1)]
    assert dict(_legend(colours, str))["4 other sources"] == COLOURS - 1
    few = _colours({**document, "sources": sources[:7]})
    assert [*few.values()] == [*range(COLOURS)]


def test_an_action_may_outlast_its_episode(registry: Registry) -> None:
    once = {"actions": [0], "action_repeat": 2**60, "subgoals": [{"subgoal": "gt_ball()", "actions": 1}]}
    record(registry, recording() | once)
    assert "gt_ball() :- {" in page(registry)


def test_without_recordings_it_is_as_it_was(registry: Registry) -> None:
    registry.files.write_document("run-3", "recordings", {})
    reseal(registry, "run-3")
    text = page(registry)
    assert "One early episode, decision by decision; score 0.90" in text
    assert "@keyframes" not in text and "Without pictures" not in text


def test_a_film_is_small_whatever_is_in_its_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "LARGEST", 40_000)
    noise = np.random.default_rng(0).integers(256, size=(10, 600, 900, 3), dtype=np.uint8)
    uri, (width, height) = film._sheet([*noise])
    assert len(uri) < 54_000 and width * height < film.MOST_POINTS
    assert width / height == pytest.approx(1.5, abs=0.05)


# Whether it can be read: WCAG 2.2, contrast of 4.5 for text and 3 for what is drawn


def luminance(colour: str) -> float:
    channels = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_colours_can_be_told_from_the_page_in_light_and_in_dark(registry: Registry) -> None:
    text = page(registry)
    schemes = re.findall(r":root \{(.*?)\}", text, re.S)
    assert len(schemes) == 2
    for scheme in schemes:
        colours = dict(re.findall(r"--([a-z0-9]+): (#[0-9a-f]{6})", scheme))
        shade = re.search(r"--shade: (\d+), (\d+), (\d+)", scheme)
        assert shade is not None
        assert min(contrast(colours[name], colours["page"]) for name in ("text", "quiet")) >= 4.5
        assert min(contrast(colours[f"c{n}"], colours["page"]) for n in range(8)) >= 3
        ground = [int(colours["page"][n : n + 2], 16) for n in (1, 3, 5)]
        mixed = [round(0.45 * int(s) + 0.55 * p) for s, p in zip(shade.groups(), ground, strict=True)]
        assert contrast(colours["text"], "#{:02x}{:02x}{:02x}".format(*mixed)) >= 4.5


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("width", [400, 1600])
def test_a_browser_shows_it_without_complaint(registry: Registry, tmp_path: Path, width: int) -> None:
    done = browsed(page(registry), tmp_path, f"--window-size={width},2000")
    assert done.count("<svg") == 2
    assert '<span class="steps">' in done and "picture " in done  # its script has run


def browsed(text: str, place: Path, *options: str) -> str:
    """What a browser makes of a page, without any complaint."""
    (place / "page.html").write_text(text)
    assert CHROMIUM is not None
    line = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", *options, "--enable-logging=stderr",
        f"--user-data-dir={place / 'browser'}", "--host-rules=MAP * ~NOTFOUND", "--virtual-time-budget=2000",
        "--dump-dom", (place / "page.html").as_uri(),
    ]  # fmt: skip
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=True)
    assert "CONSOLE" not in done.stderr
    return done.stdout


PROBE = """<script>
const [film] = document.querySelectorAll(".episode"), [hold] = film.querySelectorAll(".hold input");
const [back, forward] = film.querySelectorAll("button"), [place] = film.querySelectorAll("[type=range]");
const told = () => [getComputedStyle(film).animationPlayState, place.value].join(" ");
const states = [told().split(" ")[0]];
place.value = 7; place.oninput(); states.push(told());
forward.click(); states.push(told());
back.click(); back.click(); states.push(told());
hold.click(); states.push(told());
document.title = states.join(", ");
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("still", [False, True])
def test_a_film_can_be_held_and_stepped_and_stands_still_for_who_asks(
    registry: Registry, tmp_path: Path, still: bool
) -> None:
    free = re.sub("<meta http-equiv.*?>", "", page(registry)).replace("</body>", f"{PROBE}</body>")
    done = browsed(free, tmp_path, *(["--force-prefers-reduced-motion"] if still else []))
    begins = "paused" if still else "running"
    assert f"<title>{begins}, paused 7, paused 8, paused 6, running 6</title>" in done


def test_whatever_can_be_used_has_a_name(registry: Registry) -> None:
    text = page(registry)
    assert re.findall(r"<button type=\"button\">(.*?)</button>", text) == ["Back", "Forward"]
    assert '<label class="hold"><input type="checkbox"><span class="pause">Pause</span>' in text
    assert 'aria-label="Picture of the early episode"' in text


# The charts


def test_shares_are_stacked_to_the_top() -> None:
    text = stacked({0: [0.25, 1.0], 2: [0.75, 0.0]}, [50, 100], SIZE, "x")
    lower, upper = re.findall(r'class="area c(\d)" points="([^"]*)"', text)
    assert lower == ("0", "44.0,55.0 116.0,55.0 188.0,10.0 188.0,70.0 116.0,70.0 44.0,70.0")
    assert upper == ("2", "44.0,10.0 116.0,10.0 188.0,10.0 188.0,10.0 116.0,55.0 44.0,55.0")


def test_curves_share_their_axes() -> None:
    text = lines([Line("a & b", 0, [0, 50], [0.0, 1.0]), Line("c", 1, [0, 100], [0.5, 0.5])], 100, SIZE)
    assert re.findall(r'class="line c(\d)" points="([^"]*)"', text) == [
        ("0", "44.0,70.0 116.0,10.0"), ("1", "44.0,40.0 188.0,40.0"),
    ]  # fmt: skip
    assert "a &amp; b" in text and ">100</text>" in text
