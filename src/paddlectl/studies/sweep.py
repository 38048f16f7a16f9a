"""What a study still lacks, and what is to be run for it."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from paddlectl.experiments.jobs import Job, ResumeJob, TrainJob
from paddlectl.experiments.runner import budget_of
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.studies.cells import KEPT, MISSING, RANDOM, WAITING, Cell, Found, Runs, Source, policies_of
from paddlectl.studies.results import Result, result_of


class Step(NamedTuple):
    """A job to do for a study.

    Attributes:
        name: Of the source, or of the first cell that it is for.
        kind: `train` or `transfer`, as are the next two of the run.
        frames: Environment steps that are left at most.
    """

    job: Job
    name: str
    kind: str
    method: str
    task: str
    frames: int

    @property
    def key(self) -> str:
        """What tells it from other ways to the same."""
        return self.job.run if isinstance(self.job, ResumeJob) else self.name


class Plan(NamedTuple):
    """How far a study is.

    Attributes:
        cells: Each with its run, if there is one.
        sources: Those that cells reuse which aren't kept, likewise.
    """

    cells: Sequence[tuple[Cell, Found]]
    sources: Mapping[Source, Found]

    def steps(self, tried: Container[str] = ()) -> list[Step]:
        """What can be done next, but for what was tried before: sources first, then cells, each once."""
        for steps in (self._of_sources(tried), self._of_cells(self.ready, tried)):
            if steps:
                return steps
        return []

    @property
    def ready(self) -> list[tuple[Cell, Found]]:
        """The cells whose sources are there."""
        return [(cell, found) for cell, found in self.cells if found != WAITING]

    def count(self, state: str) -> int:
        """How many cells are in a state of `Found`."""
        return sum(found.state == state for _, found in self.cells)

    @property
    def elsewhere(self) -> list[RunRecord]:
        """Runs of the study that go on in other processes."""
        found = [*self.sources.values(), *(found for _, found in self.cells)]
        return [each.run for each in found if each.run and each.state == "running"]

    @property
    def stopped(self) -> list[RunRecord]:
        """Runs of the study that could go on."""
        found = [*self.sources.values(), *(found for _, found in self.cells)]
        return [each.run for each in found if each.run and each.state == "stopped"]

    def lacking(self, tried: Iterable[str], failed: Iterable[str]) -> dict[str, str]:
        """Cells that can't be had -> why: a source of theirs failed, or what was run isn't they."""
        of_sources = {
            cell.name: f"its source failed: {source.name}"
            for cell, found in self.cells
            if found == WAITING
            for source in cell.sources
            if source.name in failed
        }
        lost = {
            cell.name: "its run isn't found again by its content"
            for cell, found in self.cells
            if found == MISSING and cell.name in tried and cell.name not in failed
        }
        return of_sources | lost

    def left(self) -> list[Step]:
        """All that is to be done until the study is whole."""
        return [*self._of_sources(), *self._of_cells(self.cells)]

    def _of_sources(self, tried: Container[str] = ()) -> list[Step]:
        steps = [_untried(_of_source(source, found), tried) for source, found in self.sources.items()]
        return [step for step in steps if step]

    def _of_cells(self, cells: Sequence[tuple[Cell, Found]], tried: Container[str] = ()) -> list[Step]:
        """One for all cells that are served by one run; it has the name of the first."""
        steps: dict[str, Step | None] = {}
        for cell, found in cells:
            if cell.identity not in steps and found != KEPT:
                sources = [self.sources[source] for source in cell.sources]
                steps[cell.identity] = _untried(_of_cell(cell, found, sources), tried)
        return [step for step in steps.values() if step]


def plan(registry: Registry | None, cells: Sequence[Cell], kept: Container[str] = ()) -> Plan:
    """How far the registry is with the cells; nothing is done where there is none.

    Args:
        registry: Where their runs are.
        cells: Of a study.
        kept: The identities of those that a file of results has, wherever they were run.
    """
    runs = Runs(registry)
    learned = {source: runs.source(source) for cell in cells for source in cell.sources}
    known: dict[str, Found] = {}
    for cell in cells:
        if cell.identity not in known:
            found = runs.cell(cell, [learned[source] for source in cell.sources])
            known[cell.identity] = KEPT if cell.identity in kept and found.state != "finished" else found
    found_cells = [(cell, known[cell.identity]) for cell in cells]
    needed = {source for cell, found in found_cells if found != KEPT for source in cell.sources}
    return Plan(found_cells, {source: found for source, found in learned.items() if source in needed})


def finished(registry: Registry, cells: Sequence[Cell]) -> list[tuple[Cell, RunRecord]]:
    """The cells that are finished, and their runs."""
    found = plan(registry, cells).cells
    return [(cell, each.run) for cell, each in found if each.run and each.state == "finished"]


def results_of(registry: Registry, runs: Iterable[tuple[Cell, RunRecord]]) -> list[Result]:
    """The results of finished cells."""
    return [result_of(registry, run, cell.scenario.name, cell.variant, cell.identity) for cell, run in runs]


def brought_up_to_date(
    registry: Registry | None, cells: Sequence[Cell], before: Sequence[Result]
) -> list[Result]:
    """The results of cells by the registry, and where it hasn't them by those from `before`.

    Other results of `before` stay, after these, unless there is a new one of their scenario, method, variant
    and seed.
    """
    here = results_of(registry, finished(registry, cells)) if registry else []
    known = {result.cell: result for result in before} | {result.cell: result for result in here}
    results = [
        replace(known[cell.identity], scenario=cell.scenario.name, variant=cell.variant)
        for cell in cells
        if cell.identity in known
    ]
    there = {(r.scenario, r.method, r.variant, r.seed) for r in results}
    return results + [r for r in before if (r.scenario, r.method, r.variant, r.seed) not in there]


def _untried(ways: Sequence[Step], tried: Container[str]) -> Step | None:
    return next((step for step in ways if step.key not in tried), None)


def _of_source(source: Source, found: Found) -> list[Step]:
    """The ways to it, the quickest first: to go on with a run that was stopped, or to begin anew."""
    job, of = source.job(), (source.name, "train", source.method, str(source.task))
    anew = Step(job, *of, budget_of(job) if isinstance(job, TrainJob) else 0)
    return _ways(found, anew) if source.method != RANDOM or found.state != "stopped" else [anew]


def _of_cell(cell: Cell, found: Found, sources: Sequence[Found]) -> list[Step]:
    """Likewise."""
    job, of = cell.job(policies_of(sources)), (cell.name, "transfer", cell.method, str(cell.scenario.target))
    return _ways(found, Step(job, *of, cell.frames))


def _ways(found: Found, anew: Step) -> list[Step]:
    match found:
        case Found("stopped", RunRecord() as run):
            return [anew._replace(job=ResumeJob(run.id), frames=_left(run)), anew]
        case Found("finished" | "running" | "kept"):
            return []
    return [anew]


def _left(run: RunRecord) -> int:
    frames = run.settings.get("frames")
    return max(frames - run.frames, 0) if isinstance(frames, int) else 0
