"""Draws one layout of each task into docs/<task>.png, by its Gymnasium environment.

python docs/pictures.py
"""

from pathlib import Path
from typing import Any

from PIL import Image

from paddlectl.tasks.maze2d import layouts as maze2d
from paddlectl.tasks.maze2d.env import PaddleMazeEnv
from paddlectl.tasks.minigrid import layouts as minigrid
from paddlectl.tasks.minigrid.env import PaddleEnv

FOLDER = Path(__file__).parent
LAYOUT = 2  # a seed whose layouts are easy to read
TILE = 20  # pixels


def main() -> None:
    for name in minigrid.SPECS:
        draw(name, PaddleEnv(name, render_mode="rgb_array", tile_size=TILE, highlight=False))
    for name in maze2d.SPECS:
        draw(name, PaddleMazeEnv(name, render_mode="rgb_array"))


def draw(name: str, env: Any) -> None:
    env.reset(seed=LAYOUT)
    picture = Image.fromarray(env.render())
    picture.quantize(64).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
