"""The page of an explanation: it has all that is told, asks nothing of a network, and can be read."""

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from paddlectl.registry.store import Registry
from paddlectl.report.explanation import explanation_document
from paddlectl.report.page import explanation_page
from paddlectl.report.svg import Line, lines, stacked
from samples import (
    BLOCKED_DOOR,
    GAP_BALL,
    TARGET,
    add_source,
    add_transfer,
    body,
    program,
    reseal,
)

SIZE = (200, 100)
VOID = {"meta", "br", "line", "polyline", "polygon"}
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
    reseal(opened, "run-3")
    return opened


def page(registry: Registry, run: str = "run-3") -> str:
    record = registry.run(run)
    return explanation_page(registry, record, explanation_document(registry, record))


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
    assert not re.search(r"https?:|src=|href=|url\(|@import|<script|<link|<iframe", text)


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
    file = tmp_path / "page.html"
    file.write_text(page(registry))
    assert CHROMIUM is not None
    line = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--window-size={width},2000",
        "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'browser'}", "--host-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=2000", "--dump-dom", file.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.count("<svg") == 2 and "CONSOLE" not in done.stderr


# The charts


def test_shares_are_stacked_to_the_top() -> None:
    text = stacked({0: [0.25, 1.0], 2: [0.75, 0.0]}, [0, 100], SIZE, "x")
    lower, upper = re.findall(r'class="area c(\d)" points="([^"]*)"', text)
    assert lower == ("0", "44.0,55.0 188.0,10.0 188.0,70.0 44.0,70.0")
    assert upper == ("2", "44.0,10.0 188.0,10.0 188.0,10.0 44.0,55.0")


def test_curves_share_their_axes() -> None:
    text = lines([Line("a & b", 0, [0, 50], [0.0, 1.0]), Line("c", 1, [0, 100], [0.5, 0.5])], 100, SIZE)
    assert re.findall(r'class="line c(\d)" points="([^"]*)"', text) == [
        ("0", "44.0,70.0 116.0,10.0"), ("1", "44.0,40.0 188.0,40.0"),
    ]  # fmt: skip
    assert "a &amp; b" in text and ">100</text>" in text
