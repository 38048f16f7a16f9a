"""Figures: equal bytes for equal numbers, lines that are told apart, and nothing cut off or laid over."""

import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from paddlectl.methods.catalogue import METHODS
from paddlectl.report import plots
from paddlectl.report.panels import Panel, Series, csv_text
from paddlectl.report.plots import COLOURS, DASHES, MARKERS, images, shown, styles, write_figure

DRAW = """
import hashlib, sys
from test_plots import figure
from paddlectl.report.plots import images
for kind, data in images(figure(2, ("paddle", "hdm")), "a caption").items():
    print(kind, hashlib.sha256(data).hexdigest())
"""


def line(label, n=3, points=100, level=0.5):
    x, mid = (
        tuple(map(float, range(0, 1000 * points, 1000))),
        tuple(level * p / points for p in range(points)),
    )
    return Series(label, x, mid, tuple(y - 0.1 for y in mid), tuple(y + 0.1 for y in mid), n)


def figure(panels=1, labels=("paddle",), **more):
    lines = tuple(line(label, **more) for label in labels)
    return [
        Panel(f"scenario {place}", "BlockedBoxUnlockPickup", "frames", "score", lines)
        for place in range(panels)
    ]


def test_the_same_numbers_are_the_same_bytes_in_any_process(tmp_path):
    """Whatever the order of sets, the date, and the user's own settings of matplotlib."""
    (tmp_path / "matplotlibrc").write_text("font.size: 20\nsavefig.dpi: 50\nsvg.fonttype: path\n")
    here = Path(__file__)
    paths = os.pathsep.join(map(str, (here.parents[2] / "src", here.parents[1], here.parent)))
    more = {"PYTHONPATH": paths, "PYTHONHASHSEED": "1", "MATPLOTLIBRC": str(tmp_path), "TZ": "Asia/Tokyo"}
    line = [sys.executable, "-c", DRAW]
    done = subprocess.run(line, env=os.environ | more, capture_output=True, text=True, check=True)
    mine = images(figure(2, ("paddle", "hdm")), "a caption")
    assert done.stdout == "".join(
        f"{kind} {hashlib.sha256(data).hexdigest()}\n" for kind, data in mine.items()
    )


def test_files_are_written_beside_each_other_and_replaced_whole(tmp_path):
    folder = tmp_path / "new" / "figures"
    paths = write_figure(figure(), folder, "fig4")
    assert sorted(path.name for path in folder.iterdir()) == ["fig4.csv", "fig4.png", "fig4.svg"]
    assert paths["csv"].read_text() == csv_text(figure())
    before = {kind: path.read_bytes() for kind, path in paths.items()}
    assert write_figure(figure(labels=("hdm",)), folder, "fig4") == paths
    assert all(path.read_bytes() != before[kind] for kind, path in paths.items())
    assert len([*folder.iterdir()]) == 3


def test_a_figure_that_cant_be_drawn_leaves_what_was_there(tmp_path, monkeypatch):
    paths = write_figure(figure(), tmp_path, "fig4")
    before = {kind: path.read_bytes() for kind, path in paths.items()}
    monkeypatch.setattr(plots, "_saved", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_figure(figure(labels=("hdm",)), tmp_path, "fig4")
    assert {kind: path.read_bytes() for kind, path in paths.items()} == before


def test_texts_stay_texts_and_nothing_tells_when_or_by_what():
    drawn = images(figure(labels=("paddle", "hdm")), "a caption")
    texts = texts_of(drawn["svg"])
    assert {
        "scenario 0 (n = 3)",
        "BlockedBoxUnlockPickup",
        "paddle",
        "hdm",
        "frames",
        "score",
        "a caption",
    } <= texts
    assert b"dc:date" not in drawn["svg"] and b"dc:creator" not in drawn["svg"]
    assert not Image.open(io.BytesIO(drawn["png"])).text


def texts_of(svg):
    tree = ElementTree.fromstring(svg)
    return {"".join(node.itertext()).strip() for node in tree.iter("{http://www.w3.org/2000/svg}text")}


def test_each_method_has_a_style_of_its_own_in_every_figure():
    known = styles(METHODS)
    assert len({style.colour for style in known.values()}) == len(METHODS) <= len(COLOURS)
    assert styles(["cup", "paddle, without", "paddle"])["cup"] == known["cup"]
    assert styles(["new", "paddle"])["paddle"] == known["paddle"]
    many = styles([*METHODS, *map(str, range(22))]).values()
    assert len({style[1:] for style in many}) == len(many) == len(DASHES) * len(MARKERS), (
        "also without colour"
    )


@pytest.mark.parametrize(
    "name", ["$x^$", "_hidden", "", " ", "nonode", "a\nb\x00", "\ud800", "迷路", "<&>\"'", "x" * 500]
)
def test_any_name_can_be_drawn(name, tmp_path, recwarn):
    lines = (line(name), line(f"{name}, {name}"))
    written = write_figure([Panel(name, name, "frames", "score", lines)], tmp_path, "any")
    assert ElementTree.fromstring(written["svg"].read_bytes()) is not None
    assert not recwarn.list


def test_a_long_name_loses_its_middle():
    assert shown("short", 5) == "short"
    assert shown("a scenario that is long, 1", 10) == "a sce…g, 1"
    assert len(shown("x" * 99, 11)) == 11


@pytest.mark.parametrize(
    ("panels", "labels"),
    [
        (1, tuple(METHODS)),
        (1, ("paddle, with γ_body 0.5 and γ_head 0.5 and more words than a column is wide",)),
        (2, tuple(f"paddle, variant {n}" for n in range(12))),
        (8, ("paddle", "hdm")),
    ],
)
def test_nothing_is_cut_off_and_no_two_texts_overlap(panels, labels):
    names = ("A", "A scenario of a name that no panel has room for")
    lines = tuple(map(line, labels))
    told = [Panel(f"{names[n % 2]}, {n}", names[n % 2], "frames", "score", lines) for n in range(panels)]
    with plots._own_style():
        drawn = plots._drawn(told, "interquartile mean over n seeds, and its 95 % bootstrap interval")
        drawn.draw_without_rendering()
        boxes = [(text.get_text(), text.get_window_extent()) for text in visible_texts(drawn)]
    paper = drawn.bbox
    assert len(drawn.axes) == panels and len(boxes) > panels
    for place, (text, box) in enumerate(boxes):
        inside = (paper.x0 <= box.x0, box.x1 <= paper.x1, paper.y0 <= box.y0, box.y1 <= paper.y1)
        assert all(inside), text
        assert not [(text, other) for other, its in boxes[place + 1 :] if box.overlaps(its)]


def visible_texts(drawn):
    """Also of ticks, of which the axes keep more than they show."""
    from matplotlib.text import Text

    ticks = {
        label: low <= label.get_position()[side] <= high
        for axes in drawn.axes
        for side, (axis, (low, high)) in enumerate(
            ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim()))
        )
        for label in axis.get_ticklabels()
    }
    found = [text for text in drawn.findobj(Text) if text.get_text() and text.get_visible()]
    return [text for text in found if ticks.get(text, True)]


def test_a_panel_reaches_as_high_and_low_as_its_bands():
    for level, low, high in ((0.3, -0.1, 1.0), (50.0, -0.1, 49.6), (-2.0, -2.08, 1.0)):
        with plots._own_style():
            (axes,) = plots._drawn(figure(level=level), "").axes
        bottom, top = axes.get_ylim()
        assert bottom < low < high * 0.95 < top < high * 1.1


@pytest.mark.parametrize("points", [0, 1, 2])
def test_a_few_points_are_seen(points):
    with plots._own_style():
        (axes,) = plots._drawn(figure(points=points), "").axes
    (drawn,) = axes.get_lines()
    assert len(drawn.get_xdata()) == points and drawn.get_marker() == "."
    assert [note.get_text() for note in axes.texts] == ([] if points else ["no points"])
    assert images(figure(points=points))


def test_one_seed_has_no_band():
    with plots._own_style():
        counts = [len(plots._drawn(figure(n=n), "").axes[0].collections) for n in (1, 2)]
    assert counts == [0, 1]
