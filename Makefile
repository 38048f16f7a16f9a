# `make demo` and `make test` need Python 3.11 and nothing else: they make .venv on their first run.
PYTHON ?= python3.11
BIN := .venv/bin
READY := .venv/.ready
DEMO := build/demo

export OMP_NUM_THREADS ?= 1

.PHONY: setup demo test check soak bench bench-ablations bench-maze clean

setup: $(READY)

$(READY): pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -e '.[dev,maze]'
	touch $@

# The main job in a registry of its own, by the commands that a user types.
demo: export PADDLECTL_REGISTRY = $(DEMO)
demo: export PATH := $(CURDIR)/$(BIN):$(PATH)
demo: $(READY)
	rm -rf $(DEMO)
	paddlectl train BlockedDoor GapBall
	paddlectl similarity --target BlockedBoxUnlockPickup --source BlockedDoor --source GapBall
	paddlectl transfer scenarios/A.yaml --seed 0 --frames 60000
	paddlectl explain latest

test: $(READY)
	$(BIN)/python -m pytest -n 2

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2

# The long tier of the reliability tests, for hours; SHARE=0.1 runs a tenth of it.
SHARE ?= 1
soak: $(READY)
	$(BIN)/python tests/soak.py --share $(SHARE)

# Learning and transfer over seeds, and speed; ablations and the maze take longer still.
bench: BENCH := learning.py sb3_reference.py training_speed.py engine_speed.py greedy_lengths.py
bench-ablations: BENCH := ablations.py "maze.py --parts ablations --seeds 10 11 12 --frames 1000000"
bench-maze: BENCH := "maze.py --parts sources paddle guided hdm" "maze.py --parts scratch --seeds 10 11 12"

bench bench-ablations bench-maze: $(READY)
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -e '.[dev,maze,bench]'
	@for script in $(BENCH); do echo "== $$script"; $(BIN)/python benchmarks/$$script || exit 1; done

clean:
	rm -rf .venv build dist src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find src tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
