"""Figures as SVG and PNG beside their numbers as CSV: the same numbers give the same bytes.

Colours are such as colour-blind readers can tell apart; line style and marker tell the same once more.
"""

import io
import logging
import math
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from paddlectl.errors import PaddlectlError
from paddlectl.methods.catalogue import METHODS
from paddlectl.registry.files.objects import write_atomically
from paddlectl.report.panels import Panel, Series, csv_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# Tol's muted scheme, with black, and with the darker yellow of his high contrast for its sand.
COLOURS = (
    "#332288", "#CC6677", "#117733", "#999933", "#882255",
    "#88CCEE", "#000000", "#44AA99", "#AA4499", "#DDAA33",
)  # fmt: skip
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
MARKERS = ("", "o", "^", "s", "v", "D", "X", "P")

COLUMN, TEXT = 3.4, 7.0  # a paper's widths, in inches
PANEL = 2.1  # height of a panel, in inches
LINE = 0.17  # of the legend
LETTER = 0.062
FEW = 10  # points of a line, of which each is marked
DPI = 200
COLUMNS = {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}  # of so many panels; else 4

STYLE: dict[Any, Any] = {
    "font.size": 7, "axes.titlesize": 7, "axes.linewidth": 0.6, "lines.linewidth": 1.1,
    "lines.markersize": 3, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False,
    "legend.handlelength": 3, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.linewidth": 0.4, "grid.color": "#DDDDDD", "axes.axisbelow": True,
    "text.parse_math": False, "svg.fonttype": "none", "svg.hashsalt": "paddlectl",
}  # fmt: skip
METADATA = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}


class Style(NamedTuple):
    """How a line is told from the others."""

    colour: str
    dashes: Any
    marker: str


def require_matplotlib() -> None:
    """Tells what to install if there is nothing to draw with.

    Raises:
        PaddlectlError: If there is no matplotlib.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it tells of its caches
    os.environ["MPLBACKEND"] = "agg"  # a notebook's shell may name one that isn't installed here
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise PaddlectlError(
            "figures need matplotlib, which isn't installed", "run: pip install 'paddlectl[plots]'"
        ) from None


def write_figure(panels: Sequence[Panel], folder: Path, name: str, caption: str = "") -> dict[str, Path]:
    """Draws the panels and writes the figure; one of the same name is replaced, each file at once.

    Args:
        panels: At least one.
        folder: Is made if it isn't there.
        name: Of the files, without suffix.
        caption: What the lines are.

    Returns:
        `svg`, `png` and `csv`: where they are.
    """
    files = {**images(panels, caption), "csv": csv_text(panels).encode("utf-8", "backslashreplace")}
    folder.mkdir(parents=True, exist_ok=True)
    paths = {kind: folder / f"{name}.{kind}" for kind in files}
    for kind, data in files.items():
        write_atomically(paths[kind], data, shared=False)
    return paths


def images(panels: Sequence[Panel], caption: str = "") -> dict[str, bytes]:
    """The figure as `svg` and `png`."""
    with _own_style():
        figure = _drawn(panels, caption)
        return {kind: _saved(figure, kind) for kind in METADATA}


@contextmanager
def _own_style() -> Iterator[None]:
    """Whatever the user's own settings of matplotlib are."""
    import matplotlib as mpl

    with mpl.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of letters that the font lacks
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def _saved(figure: "Figure", kind: str) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format=kind, dpi=DPI, metadata=METADATA[kind])
    return file.getvalue()


def _drawn(panels: Sequence[Panel], caption: str) -> "Figure":
    """The panels side by side, with one legend below them."""
    from matplotlib.figure import Figure

    look = styles(dict.fromkeys(one.label for panel in panels for one in panel.series))
    columns = COLUMNS.get(len(panels), 4)
    rows = math.ceil(len(panels) / columns)
    width = COLUMN if columns == 1 else TEXT
    samples = [_sample(label, style, int(width / LETTER) - 10) for label, style in look.items()]
    beside = max(1, int(width / (LETTER * max(len(str(one.get_label())) for one in samples) + 0.6)))
    lines = math.ceil(len(samples) / beside) + bool(caption)
    figure = Figure(figsize=(width, rows * PANEL + lines * LINE + 0.1), layout="constrained")
    places = [*figure.subplots(rows, columns, squeeze=False).flat]
    for axes in places[len(panels) :]:
        axes.remove()
    for place, (axes, panel) in enumerate(zip(places, panels, strict=False)):
        _draw(axes, panel, look, int(width / columns / LETTER) - 4)
        if place + columns >= len(panels) or panels[place + columns].x_label != panel.x_label:
            axes.set_xlabel(panel.x_label)
        if place % columns == 0 or panels[place - 1].y_label != panel.y_label:
            axes.set_ylabel(panel.y_label)
    figure.legend(handles=samples, loc="outside lower center", ncols=beside, title=caption or None)
    return figure


def styles(labels: Iterable[str]) -> dict[str, Style]:
    """A style for each label; a method alone has the same in every figure."""
    labels = [*labels]
    taken = {label: place for place, label in enumerate(METHODS) if label in labels}
    free = (place for place in range(len(labels) + len(METHODS)) if place not in taken.values())
    return {label: _style(taken[label] if label in taken else next(free)) for label in labels}


def _style(place: int) -> Style:
    markers = place // len(DASHES) % len(MARKERS)
    return Style(COLOURS[place % len(COLOURS)], DASHES[place % len(DASHES)], MARKERS[markers])


def shown(name: str, most: int) -> str:
    """A name as a figure has room for it, in so many letters at most; what is left out is in its middle."""
    text = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name)
    return text if len(text) <= most else f"{text[: most // 2]}…{text[len(text) - (most - 1) // 2 :]}"


def _draw(axes: "Axes", panel: Panel, look: dict[str, Style], letters: int) -> None:
    """One panel, so many letters wide."""
    from matplotlib.ticker import EngFormatter, MaxNLocator

    for place, one in enumerate(panel.series):
        _line(axes, one, look[one.label], place)
    if not any(one.x for one in panel.series):
        axes.annotate("no points", (0.5, 0.5), xycoords="axes fraction", ha="center")
    top = max([1.0, *(1.05 * value for one in panel.series for value in one.high)])
    bottom = min([0.0, *(value for one in panel.series for value in one.low)])
    right = max([1.0, *(x for one in panel.series for x in one.x)])
    axes.set_ylim(bottom - 0.02 * top, 1.02 * top)
    axes.set_xlim(-0.02 * right, 1.02 * right)
    axes.set_title(_heading(panel, letters))
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _heading(panel: Panel, letters: int) -> str:
    seeds = f" ({panel.seeds})" if panel.counted else ""
    note = f"\n{shown(panel.note, letters)}" if panel.note else ""
    return shown(panel.title, letters - len(seeds)) + seeds + note


def _line(axes: "Axes", one: Series, style: Style, place: int) -> None:
    """One series; a few of many points are marked, others than those of the lines before it."""
    few = len(one.x) <= FEW
    every = max(1, len(one.x) // FEW)
    axes.plot(
        one.x,
        one.mid,
        color=style.colour,
        linestyle=style.dashes,
        marker=style.marker or ("." if few else ""),
        markevery=(place % every, every),
    )
    if one.n > 1:
        axes.fill_between(one.x, one.low, one.high, color=style.colour, alpha=0.15, linewidth=0)


def _sample(label: str, style: Style, letters: int) -> "Line2D":
    """What the legend shows of a label."""
    from matplotlib.lines import Line2D

    look = {"color": style.colour, "linestyle": style.dashes, "marker": style.marker}
    return Line2D([], [], **look, label=shown(label, letters))
