"""Text and rows at any width: an id or a name always stands whole on a line, so that it can be pasted."""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, JustifyMethod, RenderResult
from rich.padding import Padding
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from paddlectl.report.spelling import spelled

NARROWEST = 20  # columns of a text that breaks, if it has so many


@dataclass(frozen=True)
class Prose:
    """Text that breaks between words; a word that is too long for the width stands whole nevertheless.

    Attributes:
        indent: Columns before each line, where they leave room.
    """

    text: str
    indent: int = 0
    style: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in wrapped(spelled(self.text, console.encoding), options.max_width - self.indent):
            indent = max(0, min(self.indent, options.max_width - cell_len(line)))
            yield _whole(" " * indent + line, self.style)


@dataclass(frozen=True)
class Heading:
    """A blank line, then a text with a rule after it."""

    text: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        text = spelled(self.text, console.encoding)
        yield ""
        yield Rule(text, align="left", style="dim") if cell_len(text) < options.max_width else Prose(text)


@dataclass(frozen=True)
class Head:
    """What stands above a column, and how the column gives way in a narrow terminal.

    Attributes:
        right: Aligned right, as numbers are.
        breaks: Its texts break between words; others never do.
        spare: It is left out if there is no room.
    """

    title: str = ""
    right: bool = False
    breaks: bool = False
    spare: bool = False


class Row(NamedTuple):
    """The cells of a row, and the style of all of them."""

    cells: Sequence[str]
    style: str = ""


@dataclass(frozen=True)
class Grid:
    """A table. Where it is too wide, spare columns are left out, the last one first, and it says so.

    Where that isn't enough, each row becomes lines of its own with the headings before the values.

    Attributes:
        rows: None is a blank line.
        indent: Columns before each line.
        gap: Columns between two others, 2 or 3; without headings 1.
    """

    heads: Sequence[Head]
    rows: Sequence[Row | None]
    title: str = ""
    indent: int = 0
    gap: int = 3

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        titles = [spelled(head.title, console.encoding) for head in self.heads]
        rows = [
            row and Row([spelled(cell, console.encoding) for cell in row.cells], row.style)
            for row in self.rows
        ]
        if self.title:
            yield Prose(self.title, style="italic")
        least, most = self._widths(titles, rows)
        room = options.max_width - self.indent
        kept = [*range(len(titles))]
        spare = [column for column in kept if self.heads[column].spare]
        while spare and self._needed(kept, least) > room:
            kept.remove(spare.pop())
        left_over = room - self._needed(kept, least)
        if left_over < 0:
            yield from self._lines(titles, rows, options.max_width)
            return
        widths = _shared(least, most, left_over)
        yield Padding(self._table(kept, titles, rows, widths), (0, 0, 0, self.indent), expand=False)
        if left_out := [title for column, title in enumerate(titles) if column not in kept]:
            names = ", ".join(dict.fromkeys(left_out))
            yield Prose(f"Too narrow for {names}; --json has all.", self.indent)

    @property
    def _headed(self) -> bool:
        return any(head.title for head in self.heads)

    def _widths(self, titles: Sequence[str], rows: Sequence[Row | None]) -> tuple[list[int], list[int]]:
        """The least and the most that each column can use."""
        least, most = [cell_len(title) for title in titles], [cell_len(title) for title in titles]
        for row in filter(None, rows):
            for column, cell in enumerate(row.cells):
                length = _longest(cell.split("\n"))
                most[column] = max(most[column], length)
                if self.heads[column].breaks:
                    length = max(_longest(cell.split()), min(length, NARROWEST))
                least[column] = max(least[column], length)
        return least, most

    def _needed(self, kept: Sequence[int], widths: Sequence[int]) -> int:
        between = self.gap * (len(kept) - 1) + 2 if self._headed else len(kept) - 1
        return sum(widths[column] for column in kept) + between

    def _table(
        self, kept: Sequence[int], titles: Sequence[str], rows: Sequence[Row | None], widths: Sequence[int]
    ) -> Table:
        drawn = Table(
            box=box.SIMPLE_HEAD if self._headed else None,
            show_header=self._headed,
            pad_edge=False,
            collapse_padding=self.gap < 3 or not self._headed,
        )
        for column in kept:
            head = self.heads[column]
            justify: JustifyMethod = "right" if head.right else "left"
            drawn.add_column(titles[column], justify=justify, width=widths[column], no_wrap=True)
        for row in rows:
            if row is None:
                drawn.add_section()
            else:
                cells = ("\n".join(wrapped(row.cells[column], widths[column])) for column in kept)
                drawn.add_row(*cells, style=row.style)
        return drawn

    def _lines(self, titles: Sequence[str], rows: Sequence[Row | None], width: int) -> RenderResult:
        for row in filter(None, rows):
            if not self._headed:
                yield Prose(" ".join(filter(None, row.cells)), self.indent, row.style)
                continue
            yield ""
            for head, title, cell in zip(self.heads, titles, row.cells, strict=True):
                line = f"{title}: {cell}"
                if cell and (head.breaks or cell_len(line) <= width):
                    yield Prose(line, style=row.style)
                elif cell:
                    yield from (_whole(f"{title}:", row.style), _whole(cell, row.style))
        yield ""


def wrapped(text: str, width: int) -> list[str]:
    """The text in lines of that width; longer only where a word is."""
    lines: list[str] = []
    for line in text.split("\n"):
        if cell_len(line) <= width:
            lines.append(line)
        else:
            lines += textwrap.wrap(line, max(1, width), break_long_words=False, break_on_hyphens=False)
    return lines


def _whole(text: str, style: str) -> Text:
    return Text(text, style, no_wrap=True, overflow="ignore")


def _longest(texts: Iterable[str]) -> int:
    return max(map(cell_len, texts), default=0)


def _shared(least: Sequence[int], most: Sequence[int], left_over: int) -> list[int]:
    """The least widths with what is left over, each by its share of what they all lack."""
    lacked = sum(most) - sum(least)
    given = min(left_over, lacked)
    return [low + (high - low) * given // max(1, lacked) for low, high in zip(least, most, strict=True)]
