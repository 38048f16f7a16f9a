"""Draws one layout of each MiniGrid task into docs/<task>.png, by MiniGrid's own renderer.

python docs/pictures.py
"""

from pathlib import Path

from PIL import Image

from paddlectl.tasks import suite
from paddlectl.tasks.minigrid.env import PaddleEnv

FOLDER = Path(__file__).parent
LAYOUT = 2  # a seed whose layouts are easy to read
TILE = 20  # pixels


def main() -> None:
    for name in suite.names():
        env = PaddleEnv(name, render_mode="rgb_array", tile_size=TILE, highlight=False)
        env.reset(seed=LAYOUT)
        picture = Image.fromarray(env.render())
        picture.quantize(64).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
