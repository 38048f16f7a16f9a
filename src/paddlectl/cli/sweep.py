"""`paddlectl sweep`."""

import re
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl import shipped
from paddlectl.cli.options import (
    AsJson,
    CheckpointEvery,
    Jobs,
    ManySeeds,
    RegistryPlace,
    StudyFrames,
    TaskFiles,
    at_home,
    chosen_seeds,
    complete_studies,
    file_at,
)
from paddlectl.cli.output_files import require_output, unwritable
from paddlectl.cli.texts import here
from paddlectl.errors import NotFoundError, PaddlectlError, UsageError
from paddlectl.registry.names import quoted, shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence, Set

    from paddlectl.experiments.jobs import Failure
    from paddlectl.registry.store import Registry
    from paddlectl.studies.cells import Cell
    from paddlectl.studies.results import Result
    from paddlectl.studies.sweep import Plan

EXAMPLE = "Example: paddlectl sweep paper/fig4 --dry-run"
SECONDS = 5e-4  # that a frame takes about, where no run tells
PATIENCE = 1.0  # seconds between two looks at runs that go on in other processes


StudyFile = Annotated[
    str,
    typer.Argument(
        parser=at_home,
        metavar="STUDY.yaml|NAME",
        autocompletion=complete_studies,
        help="Scenarios, methods, variants and seeds to compare. Their file, or one that is shipped: "
        f"{', '.join(shipped.studies())}.",
        show_default=False,
    ),
]
ResultsFile = Annotated[
    Path | None,
    typer.Option(
        "--results",
        parser=file_at,
        metavar="FILE.json",
        help="Keep the finished cells there, for compare and plot without the registry; cells that it has "
        "already, from whatever machine, aren't run again.",
        show_default=False,
    ),
]


OnCluster = Annotated[
    str | None,
    typer.Option(
        "--on",
        metavar="ray|ADDRESS",
        help="Run on a Ray cluster: ray is this machine's, or give ray://HOST:PORT.",
        show_default=False,
    ),
]


def sweep(
    file: StudyFile,
    seeds: ManySeeds = None,
    frames: StudyFrames = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what is missing and about how long it takes; run nothing.")
    ] = False,
    fail_fast: Annotated[
        bool, typer.Option("--fail-fast", help="Stop all when one fails; without, the others go on.")
    ] = False,
    results: ResultsFile = None,
    on: OnCluster = None,
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Run what is missing of a study, its sources included."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.report.output import print_json, print_text

    with stdout_kept():
        from paddlectl.cli.running import require_none
        from paddlectl.registry.store import Registry
        from paddlectl.studies.cells import cells_of
        from paddlectl.studies.results import read_results
        from paddlectl.studies.study import load_study
        from paddlectl.studies.sweep import brought_up_to_date, plan

        _require_cluster(on, jobs, checkpoint_every)
        loaded = load_study(shipped.study(file))
        if results is not None:
            _require_writable(results, dry_run)
        before = read_results(results) if results is not None and results.exists() else ()
        kept = {result.cell for result in before}
        cells = cells_of(loaded, chosen_seeds(None, seeds, loaded.study.seeds), frames)
        line = _line(file, {"--seeds": seeds, "--frames": frames})
        again = _line(
            file, {"--seeds": seeds, "--frames": frames, "--results": results, "--jobs": jobs, "--on": on}
        )
        failed: Mapping[str, Failure] = {}
        opened = _opened(registry) if dry_run else Registry.open(registry)
        try:
            if opened and not dry_run:
                failed = _run_missing(opened, cells, kept, again, fail_fast, jobs, checkpoint_every, on)
        finally:
            if results is not None and not dry_run:
                _write(results, lambda rows: brought_up_to_date(opened, cells, rows))
        now = plan(opened, cells, kept)
        left = _estimate(now, registry, jobs) if dry_run else ""
    if as_json:
        print_json(document(loaded.study.name, now, failed))
    else:
        further = [left, _next(line, again, now, dry_run)]
        print_text([f"{loaded.study.name}: {_counts(now)}", *filter(None, further)])
    require_none(failed)


def document(study: str, now: "Plan", failed: "Mapping[str, Failure]") -> dict[str, Any]:
    """What `--json` prints."""
    cells = [
        {
            "scenario": cell.scenario.name,
            "target": str(cell.scenario.target),
            "method": cell.method,
            "variant": cell.variant,
            "seed": cell.seed,
            "frames": cell.frames,
            "state": found.state,
            "run": found.run and found.run.id,
        }
        for cell, found in now.cells
    ]
    told = [{"job": name, "run": each.run, "error": str(each.error)} for name, each in failed.items()]
    return {"study": study, "cells": cells, "failed": told}


def _require_writable(results: Path, dry_run: bool) -> None:
    """Makes sure that results can be kept there, before anything runs for them."""
    if results.is_dir():
        raise UsageError(f"{results} is a folder", "name a file in it")
    if dry_run:
        return
    try:
        results.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(results, error) from error
    require_output(results, ".json")
    _write(results, lambda rows: rows)


def _write(results: Path, change: "Callable[[Sequence[Result]], Iterable[Result]]") -> None:
    from paddlectl.studies.results import change_results

    try:
        change_results(results, change)
    except OSError as error:
        raise unwritable(results, error) from error


def _require_cluster(on: str | None, jobs: int | None, checkpoint_every: float | None) -> None:
    if on is None:
        return
    if on != "ray" and not re.fullmatch(r"(ray://)?[^\s/:]+:[0-9]+", on):
        raise UsageError(f"{shown(on)} is no Ray cluster", "give ray, ray://HOST:PORT or HOST:PORT")
    for name, value in {"--jobs": jobs, "--checkpoint-every": checkpoint_every}.items():
        if value is not None:
            raise UsageError(f"{name} and --on exclude each other", "Ray chooses how many runs go on")


def _opened(registry: str) -> "Registry | None":
    """The registry, if there is one; none is made to look at it."""
    from paddlectl.registry.store import Registry

    with suppress(NotFoundError):
        return Registry.open(registry, create=False)
    return None


def _run_missing(
    registry: "Registry",
    cells: "Sequence[Cell]",
    kept: "Set[str]",
    again: str,
    fail_fast: bool,
    jobs: int | None,
    checkpoint_every: float | None,
    on: str | None,
) -> "Mapping[str, Failure]":
    """Runs sources and cells until all have ended; how those failed that did, by their names."""
    from paddlectl.cli.running import Asked, run_each
    from paddlectl.experiments.jobs import Failure
    from paddlectl.studies.sweep import plan

    failed: dict[str, Failure] = {}
    tried: set[str] = set()
    waited = ""
    tasks = {str(task) for cell in cells for task in (cell.scenario.target, *cell.scenario.source_names)}
    registry.require_free(None, tasks)
    try:
        with registry.files.sweeping():
            while True:
                now = plan(registry, cells, kept)
                if on:  # what was stopped here can't go on there
                    tried |= {run.id for run in now.stopped}
                if steps := now.steps(tried):
                    tried |= {step.key for step in steps}
                    asked = [Asked(*step) for step in steps]
                    ended = run_each(
                        asked, registry.location, checkpoint_every, jobs, fail_fast=fail_fast, on=on
                    )
                    for step in steps:
                        failed.pop(step.name, None)
                    failed |= ended.failed
                elif now.elsewhere:
                    waited = _waiting(now, waited)
                    time.sleep(PATIENCE)
                if (fail_fast and failed) or not (steps or now.elsewhere):
                    break
    except KeyboardInterrupt:
        print(here(f"go on with: paddlectl sweep {again}"), file=sys.stderr)
        raise
    lacking = {} if fail_fast and failed else now.lacking(tried, failed)
    return failed | {name: Failure(None, PaddlectlError(why)) for name, why in lacking.items()}


def _waiting(now: "Plan", before: str) -> str:
    """Says for which runs it waits, if that isn't what it said before."""
    runs = ", ".join(dict.fromkeys(run.id for run in now.elsewhere))
    if runs != before:
        print(f"waiting for other processes, which go on with {runs}", file=sys.stderr)
    return runs


def _estimate(now: "Plan", registry: str, jobs: int | None) -> str:
    """What is missing and about how long it takes."""
    from paddlectl.cli.running import Asked, plan_of
    from paddlectl.experiments.cores import permitted

    steps = [Asked(*step) for step in now.left()]
    return f"to run: {plan_of(steps, jobs or permitted(), registry, SECONDS)}" if steps else ""


def _counts(now: "Plan") -> str:
    """`324 cells: 300 finished, 24 missing`."""
    states = {
        "finished": "finished",
        "stopped": "stopped",
        "running": "running elsewhere",
        "kept": "from the file of results",
    }
    counts = {told: now.count(state) for state, told in states.items()}
    counts["missing"] = len(now.cells) - sum(counts.values())
    told = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
    return f"{len(now.cells)} cells: {told}"


def _next(line: str, again: str, now: "Plan", dry_run: bool) -> str:
    if dry_run:
        return here(f"run it: paddlectl sweep {again}") if now.left() else ""
    return here(f"next: paddlectl compare {line}") if now.count("finished") else ""


def _line(file: str, options: "Mapping[str, object]") -> str:
    """The study as it was asked for, with these options."""
    given = (str(word) for each in options.items() if each[1] is not None for word in each)
    return " ".join(map(quoted, [file, *given]))
