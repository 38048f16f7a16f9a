"""A recorded episode as a moving picture of a page: one sheet of pictures, and what is told of each step."""

import base64
import io
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from paddlectl.experiments.recordings import Moment, played_again
from paddlectl.logic.atoms import Literal
from paddlectl.registry.records import RunRecord
from paddlectl.report.mapping import scene_text
from paddlectl.report.output import clean
from paddlectl.tasks.base import Bools, Task
from paddlectl.tasks.naming import kept
from paddlectl.tasks.suite import load

MOST = 100
"""Pictures of a film."""
MOST_POINTS = 120_000
"""Of a picture; a larger one is made smaller."""
LARGEST = 400_000
"""Bytes of a sheet."""
COLUMNS = 8
PER_SECOND = 5
LAST = 8
"""Times as long as the others the last picture is shown."""

Document = Mapping[str, Any]
Picture = NDArray[np.uint8]


class Part(NamedTuple):
    """Some steps of an episode of which the same is told.

    Attributes:
        first: Steps before them.
        scene: What holds there.
        leader: Id of the policy that led, or that was followed most in the scene; empty if that isn't known.
        share: Of the choices in the scene, how many followed it; None if it led.
        subgoal: What was gone for; empty without subgoals.
    """

    first: int
    scene: str
    leader: str
    share: float | None
    subgoal: str


class Frame(NamedTuple):
    """A picture of a film.

    Attributes:
        when: It comes, in percent of the film.
        across, down: Where it is on the sheet, in percent as `background-position` counts them.
        step: Steps before it.
        part: Number of its part; at the end as many as there are parts.
    """

    when: float
    across: float
    down: float
    step: int
    part: int


class Film(NamedTuple):
    """A recorded episode.

    Attributes:
        sheet: All its pictures side by side, in rows of `COLUMNS`; a data URI.
        size: Width and height of one, in points.
        steps: Steps before each picture.
        parts: What is told, in order.
    """

    sheet: str
    size: tuple[int, int]
    steps: Sequence[int]
    parts: Sequence[Part]

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return (len(self.steps) - 1 + LAST) / PER_SECOND

    @property
    def rows(self) -> int:
        """Of the sheet."""
        return -(-len(self.steps) // COLUMNS)

    def frames(self) -> Iterator[Frame]:
        """Its pictures, in order."""
        begins = [part.first for part in self.parts]
        for number, step in enumerate(self.steps):
            row, column = divmod(number, COLUMNS)
            yield Frame(
                100 * number / (len(self.steps) - 1 + LAST),
                100 * column / (COLUMNS - 1),
                100 * row / max(1, self.rows - 1),
                step,
                len(begins) if step == self.steps[-1] else sum(first <= step for first in begins) - 1,
            )


def film(
    run: RunRecord, recording: Document, decisions: Sequence[Document], reuse: Sequence[Document]
) -> Film:
    """Plays a recorded episode again and draws it.

    Args:
        run: Whose it is.
        recording: The episode.
        decisions: Of the same episode, if they were traced.
        reuse: Whom the run followed where.

    Raises:
        PaddlectlError: If the episode can't be played again, or not be drawn.
    """
    asked, length = kept(*run.content), recording["length"]
    every = max(1, -(-length // (MOST - 1)))
    steps = [*range(0, length, every), length]
    moments = [*played_again(asked, recording, {*steps})]
    if sum(decision["steps"] for decision in decisions) == length:
        parts = [*_decided(decisions)]
    else:
        parts = [*_gone_through(load(asked), moments[:-1], recording, reuse)]
    pictures = [moment.picture for moment in moments if moment.picture is not None]
    return Film(*_sheet(pictures), steps, parts)


# What is told


def _decided(decisions: Sequence[Document]) -> Iterator[Part]:
    first = 0
    for decision in decisions:
        yield Part(first, scene_text(decision["scene"]), decision["guide"], None, clean(decision["head"]))
        first += decision["steps"]


def _gone_through(
    task: Task, moments: Sequence[Moment], recording: Document, reuse: Sequence[Document]
) -> Iterator[Part]:
    followed, goals = _followed(reuse, recording["frames"]), [*_goals(recording)]

    def at(moment: Moment) -> tuple[tuple[str, ...], str]:
        return _scene(task, moment.valuation), goals[moment.t] if goals else ""

    for (scene, goal), some in groupby(moments, at):
        leader, share = followed(scene)
        yield Part(next(some).t, scene_text(scene), leader, share, goal)


def _scene(task: Task, valuation: Bools) -> tuple[str, ...]:
    """Its literals, as in a program."""
    literals = map(Literal, task.vocabulary.atoms, valuation.tolist())
    return tuple(map(str, sorted(literals)))


def _goals(recording: Document) -> Iterator[str]:
    """What each step goes for; nothing without subgoals."""
    for told in recording["subgoals"]:
        steps = min(told["actions"] * recording["action_repeat"], recording["length"])
        yield from [clean(told["subgoal"])] * steps


def _followed(
    reuse: Sequence[Document], frames: int
) -> Callable[[tuple[str, ...]], tuple[str, float | None]]:
    """Who was followed most in a scene when an episode ended, and its share; nobody where none was."""
    periods = sorted({row["frames"] for row in reuse})
    period = next((end for end in periods if end >= frames), periods[-1] if periods else 0)
    counts: dict[tuple[str, ...], Counter[str]] = {}
    for row in reuse:
        if row["frames"] == period:
            counts.setdefault(tuple(row["context"]), Counter())[row["source"]] += row["chosen"]

    def of(scene: tuple[str, ...]) -> tuple[str, float | None]:
        found = counts.get(scene, Counter())
        if not found.total():
            return "", None
        ((leader, chosen),) = found.most_common(1)
        return leader, chosen / found.total()

    return of


# The pictures


def _sheet(pictures: Sequence[Picture]) -> tuple[str, tuple[int, int]]:
    """All pictures as one, as a data URI, and the size of one; smaller and blurred where it must be."""
    height, width, _ = pictures[0].shape
    scale, exact = min(1.0, (MOST_POINTS / (width * height)) ** 0.5), True
    while True:
        size = max(1, round(scale * width)), max(1, round(scale * height))
        data = io.BytesIO()
        _side_by_side(pictures, size).save(data, "WEBP", lossless=exact, quality=75)
        if data.tell() <= LARGEST:
            return f"data:image/webp;base64,{base64.b64encode(data.getvalue()).decode()}", size
        scale, exact = scale if exact else scale / 2, False


def _side_by_side(pictures: Sequence[Picture], size: tuple[int, int]) -> Image.Image:
    width, height = size
    whole = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for number, picture in enumerate(pictures):
        row, column = divmod(number, COLUMNS)
        image = Image.fromarray(picture)
        whole.paste(image if image.size == size else image.resize(size), (column * width, row * height))
    return whole
