"""Moving pictures: as a GIF, and in the characters of a terminal."""

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rich.text import Text

Picture = NDArray[np.uint8]

MARGIN = 8  # pixels
LETTERS = 14  # pixels high
COLOURS = 256
LAST = 8  # times as long as the others


def gif(pictures: Sequence[Picture], captions: Sequence[str], per_second: float) -> bytes:
    """The pictures one after another, each with its caption below; the last stays a little.

    Args:
        pictures: [height, width, 3] each, all of one size.
        captions: A line for each.
        per_second: How many are shown in a second.
    """
    frames = [_captioned(*each) for each in zip(pictures, captions, strict=True)]
    palette = _palette(frames)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    each = round(1000 / per_second)
    data = io.BytesIO()
    durations = [each] * len(others) + [each * LAST]
    first.save(data, "GIF", save_all=True, append_images=others, duration=durations, loop=0, optimize=True)
    return data.getvalue()


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Colours for all the frames; one that is rare, or comes late, counts as much as any."""
    found: set[int] = set()
    for frame in frames:
        red, green, blue = np.moveaxis(np.asarray(frame, np.int64), -1, 0)
        found |= set(np.unique(red << 16 | green << 8 | blue).tolist())
    codes = np.array(sorted(found))
    colours = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], -1).astype(np.uint8)
    return Image.fromarray(colours[None]).quantize(COLOURS)


def _captioned(picture: Picture, caption: str) -> Image.Image:
    height, width, _ = picture.shape
    frame = Image.new("RGB", (width, height + LETTERS + 2 * MARGIN), "white")
    frame.paste(Image.fromarray(picture))
    font = ImageFont.load_default(LETTERS)
    ImageDraw.Draw(frame).text((MARGIN, height + MARGIN // 2), caption, "black", font)
    return frame


def blocks(picture: Picture, columns: int, encoding: str) -> Text:
    """The picture in coloured characters, each of which is two points of it, one above the other.

    Args:
        picture: [height, width, 3]
        columns: Characters in a line.
        encoding: Of the terminal; without half blocks a character is one point.
    """
    half = _has(encoding, "▀")
    height, width, _ = picture.shape
    lines = max(1, round(columns * height / width / 2))
    small = Image.fromarray(picture).resize((columns, 2 * lines if half else lines), Image.Resampling.BOX)
    points = np.asarray(small)
    text = Text()
    for line in range(lines):
        for column in range(columns):
            upper = _colour(points[2 * line if half else line, column])
            lower = _colour(points[2 * line + 1, column]) if half else upper
            text.append("▀" if half else " ", f"{upper} on {lower}")
        text.append("\n")
    return text


def _colour(point: NDArray[np.uint8]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*point.tolist())


def _has(encoding: str, character: str) -> bool:
    try:
        character.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True
