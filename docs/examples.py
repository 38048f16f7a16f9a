"""Makes the pages of docs/examples/ from real runs, by the commands that users have.

python docs/examples.py FOLDER

FOLDER is a registry; what it has isn't learned again. From nothing it takes a quarter of an hour.
"""

import argparse
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parent / "examples"
COMMANDS = (
    "train BlockedBoxUnlockPickup --frames 100000 --seed 0 --tag example-rooms",
    "train CoffeeMailMaze --frames 120000 --seed 0 --tag example-maze-scratch",
    "transfer A --frames 60000 --seed 0 --train-missing --name example-A",
    "transfer C --frames 100000 --seed 0 --train-missing --name example-C",
    "transfer maze --seed 0 --train-missing --name example-maze",
    "transfer A --method qmp --frames 100000 --seed 0 --train-missing --name example-qmp",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("registry", metavar="FOLDER")
    place = ["--registry", parser.parse_args().registry]
    runs = _paddlectl("runs", "--all", "--json", *place).stdout if Path(place[1]).is_dir() else ""
    for command in COMMANDS:
        *_, label = command.split()
        if label not in runs:
            _paddlectl(*command.split(), *place)
    for name in ("A", "C", "maze", "qmp"):
        _paddlectl("explain", f"example-{name}", "--html", str(EXAMPLES / f"{name}.html"), *place)


def _paddlectl(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(  # noqa: S603
        [sys.executable, "-m", "paddlectl", *words], check=True, capture_output=True, text=True
    )


if __name__ == "__main__":
    main()
