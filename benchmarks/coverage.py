"""In which share of made-up studies an interval holds the truth: the plain bootstrap, and the expanded one.

python benchmarks/coverage.py

The studies are those of tests/covered.py, 2,000 of each; the shares go to coverage.json beside this script.
"""

import json
import sys
from pathlib import Path

from learning import commit, machine

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))
from covered import STUDIES, coverage  # noqa: E402

TRIALS = 2000
SEEDS = (10, 6, 4)


def main() -> None:
    shares = {
        f"{name}, {seeds} seeds": {
            kind: coverage(name, seeds, TRIALS, expanded=kind == "expanded") for kind in ("plain", "expanded")
        }
        for name in STUDIES
        for seeds in SEEDS
    }
    for name, share in shares.items():
        print(f"{name}: plain {share['plain']:.3f}, expanded {share['expanded']:.3f}")
    told = {"trials": TRIALS, "commit": commit(), "machine": machine(), "shares": shares}
    (HERE / "coverage.json").write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
