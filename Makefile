# `make demo` and `make test` need Python 3.11 and nothing else: they make .venv on their first run, of the
# versions that .ci/requirements.lock names; LOCK=no takes the newest that pyproject.toml allows.
PYTHON ?= python3.11
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --quiet
LOCKED := $(INSTALL) --no-deps --require-hashes -r
LOCK ?= yes
READY := .venv/.ready
DEMO := build/demo

export OMP_NUM_THREADS ?= 1

.PHONY: setup lock demo test check soak bench bench-maze paper clean

setup: $(READY)

$(READY): pyproject.toml $(wildcard .ci/*.lock)
	$(PYTHON) -m venv .venv
ifeq ($(LOCK),no)
	$(INSTALL) -e '.[dev,maze]'
else
	@$(LOCKED) .ci/torch-cpu.lock --retries 1 2>/dev/null || echo "no CPU build of PyTorch is found: PyPI's, with CUDA"
	@$(LOCKED) .ci/requirements.lock || { echo "to take what fits this machine: make setup LOCK=no" >&2; exit 1; }
	@$(BIN)/python -m pip check >/dev/null || $(LOCKED) .ci/torch-cuda.lock
	$(INSTALL) --no-deps --no-build-isolation -e .
endif
	touch $@

# Writes the lock files anew where the ranges in pyproject.toml ask for it; UPGRADE=1 takes the newest.
lock:
	.ci/lock

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
	$(BIN)/python -m pytest -n 3

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 3

# The long tier of the reliability tests, for hours; SHARE=0.1 runs a tenth of it.
SHARE ?= 1
soak: $(READY)
	$(INSTALL) -e '.[dev,maze,ray]'
	$(BIN)/python tests/soak.py --share $(SHARE)

# Learning and transfer over seeds, and speed; the maze takes longer still.
bench: BENCH := learning.py sb3_reference.py training_speed.py engine_speed.py greedy_lengths.py
bench-maze: BENCH := "maze.py --parts sources paddle guided hdm" "maze.py --parts scratch --seeds 10 11 12"
bench-maze: BENCH += "maze.py --parts ablations --seeds 10 11 12 --frames 1000000"

bench bench-maze: $(READY)
	$(INSTALL) -e '.[dev,maze,bench]'
	@for script in $(BENCH); do echo "== $$script"; $(BIN)/python benchmarks/$$script || exit 1; done

# What is missing of the paper's studies, hours of it, their figures, and docs/results.md.
STUDIES ?= fig3 fig4 fig5 fig6a fig6b ablation-weights ablation-rules ablation-paper
paper: export PADDLECTL_REGISTRY ?= build/paper
paper: $(READY)
	@for study in $(STUDIES); do \
	  $(BIN)/paddlectl sweep scenarios/paper/$$study.yaml --results benchmarks/paper/$$study.json && \
	  $(BIN)/paddlectl plot scenarios/paper/$$study.yaml --to docs/figures || exit 1; done
	$(BIN)/python benchmarks/paper.py

clean:
	rm -rf .venv build dist src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find src tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
