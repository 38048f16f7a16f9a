"""`paddlectl compare`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeVar

import typer

from paddlectl import shipped
from paddlectl.cli.explain import SCENARIO
from paddlectl.cli.options import (
    AsJson,
    ManySeeds,
    RegistryPlace,
    StudyFrames,
    TaskFiles,
    at_home,
    chosen_seeds,
    complete_compared,
    complete_figures,
    complete_results,
    complete_tasks,
    one_method_of,
)
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.methods.catalogue import METHODS
from paddlectl.registry.names import quoted

if TYPE_CHECKING:
    from paddlectl.registry.records import RunRecord
    from paddlectl.studies.results import Result

T = TypeVar("T")
EXAMPLE = "Example: paddlectl compare --scenario A --method paddle --method hdm"
STUDIES = (".yaml", ".yml")
MOST_NAMED = 6


class Traits(NamedTuple):
    """By what runs and results are chosen."""

    scenario: str
    method: str
    task: str
    seed: str


ComparedFile = Annotated[
    str | None,
    typer.Argument(
        parser=at_home,
        metavar="FILE|NAME",
        autocompletion=complete_results,
        help="A study, as sweep takes it, or a file of results (.json). "
        "Without: the finished transfers of the registry.",
        show_default=False,
    ),
]
Scenarios = Annotated[
    list[str] | None,
    typer.Option(
        metavar="S",
        autocompletion=complete_compared,
        help="Only this scenario; repeat for more.",
        show_default=False,
    ),
]
Methods = Annotated[
    list[str] | None,
    typer.Option(
        metavar="M",
        autocompletion=one_method_of(METHODS),
        help="Only this method; repeat for more.",
        show_default=False,
    ),
]
Targets = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TASK",
        autocompletion=complete_tasks,
        help="Only this target; repeat for more.",
        show_default=False,
    ),
]
Figure = Annotated[
    str,
    typer.Option(
        metavar="FIGURE",
        autocompletion=complete_figures,
        help="What is shown: area_under_curve, jump_start, final_score or frames_to_success.",
    ),
]
Chosen = Annotated[
    str | None,
    typer.Option(
        metavar="METHOD",
        autocompletion=one_method_of(METHODS),
        help="The one that each other is compared with; paddle without.",
        show_default=False,
    ),
]


def compare(
    file: ComparedFile = None,
    scenario: Scenarios = None,
    method: Methods = None,
    task: Targets = None,
    figure: Figure = "area_under_curve",
    of: Chosen = None,
    seeds: ManySeeds = None,
    frames: StudyFrames = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Put methods side by side, with intervals over their seeds."""
    from paddlectl.report.compared import compared_parts
    from paddlectl.report.output import print_json, print_text
    from paddlectl.studies.comparison import comparison_document

    require_figure(figure)
    of_study = file is not None and shipped.study(file).suffix in STUDIES
    if not of_study and frames is not None:
        raise UsageError("--frames chooses cells of a study (.yaml)", "leave it out")
    wanted = {"scenario": scenario or (), "method": method or (), "task": task or ()}
    if not of_study:
        wanted["seed"] = [*map(str, chosen_seeds(None, seeds, ()))]
    if file is None:
        results, notes = from_registry(registry, wanted)
    elif of_study:
        results, notes = from_study(registry, file, wanted, seeds, frames)
    else:
        results, notes = from_file(Path(file), wanted), []
    document = {"figure": figure, **comparison_document(results, of, notes)}
    if as_json:
        print_json(document)
    else:
        print_text(compared_parts(document, figure))


def require_figure(figure: str) -> None:
    """Refuses what is no figure.

    Raises:
        UsageError: With the nearest one.
    """
    from paddlectl.registry.names import nearest, shown
    from paddlectl.studies.grouped import FIGURES

    if figure not in FIGURES:
        near = nearest(figure, FIGURES)
        raise UsageError(f"unknown figure {shown(figure)}", f"{near}one of: {', '.join(FIGURES)}")


def from_study(
    place: str, file: str, wanted: "Mapping[str, Sequence[str]]", seeds: str | None, frames: int | None
) -> "tuple[list[Result], list[str]]":
    """The finished cells of a study, and how many aren't."""
    from paddlectl.registry.store import Registry
    from paddlectl.studies.cells import cells_of
    from paddlectl.studies.study import load_study
    from paddlectl.studies.sweep import finished, results_of

    loaded = load_study(shipped.study(file))
    cells = cells_of(loaded, chosen_seeds(None, seeds, loaded.study.seeds), frames)
    opened = Registry.open(place, create=False)
    results = results_of(opened, finished(opened, cells))
    left = len(cells) - len(results)
    notes = [f"{left} of the study's {len(cells)} cells aren't finished"] if left else []
    way = f"paddlectl sweep {quoted(file)}"
    return chosen(results, traits_of_result, wanted, file, lambda _: way), notes


def from_file(file: Path, wanted: "Mapping[str, Sequence[str]]") -> "list[Result]":
    """What a file of results holds.

    Raises:
        NotFoundError: If it isn't there.
        UsageError: If it is neither a study nor a file of results by its name.
    """
    from paddlectl.registry.names import shown
    from paddlectl.studies.results import read_results

    if file.suffix != ".json":
        raise UsageError(f"{shown(str(file))} is neither a study (.yaml) nor a file of results (.json)")
    if not file.is_file():
        raise NotFoundError(f"no file {shown(str(file))}", "run: paddlectl compare --help")
    results = read_results(file)
    way = f"paddlectl compare {quoted(str(file))}" if results else "paddlectl sweep --help"
    return chosen(results, traits_of_result, wanted, str(file), lambda _: way)


def from_registry(place: str, wanted: "Mapping[str, Sequence[str]]") -> "tuple[list[Result], list[str]]":
    """The results of the finished transfers that are wanted, and what a reader must know of the choice."""
    from paddlectl.registry.store import Registry
    from paddlectl.studies.grouped import one_of_each
    from paddlectl.studies.results import result_of

    registry = Registry.open(place, create=False)
    transfers = [run for run in registry.runs() if run.kind == "transfer"]
    finished = [run for run in transfers if run.status == "finished" and run.policy]
    fitting = chosen(finished, traits_of_run, wanted, registry.shown, _way_to_transfer)
    _require_one_task_a_name(fitting)
    runs, others = one_of_each(fitting, traits_of_run, _rank)
    runs.sort(key=lambda run: (traits_of_run(run)[:-1], run.seed))
    unfinished = [run for run in transfers if run.status != "finished" and _fits(traits_of_run(run), wanted)]
    return [result_of(registry, run) for run in runs], _notes(runs, others, len(unfinished))


def _require_one_task_a_name(runs: "Sequence[RunRecord]") -> None:
    """Refuses to put runs together whose tasks only have the same name.

    Raises:
        UsageError: If there are such.
    """
    first: dict[str, RunRecord] = {}
    for run in runs:
        other = first.setdefault(run.task, run)
        if other.content.identity != run.content.identity:
            raise UsageError(
                f"{run.task} is the name of several tasks here: {other.id} and {run.id} learned one each",
                "compare by a study, or choose others by --task or --scenario",
            )


def _way_to_transfer(method: str) -> str:
    from paddlectl.methods.catalogue import known

    by = f" --method {method}" if known(method) else ""
    return f"paddlectl transfer {SCENARIO}{by} --train-missing"


def _rank(run: "RunRecord") -> tuple[bool, int, int]:
    """Of the runs of a scenario, method and seed: by usual numbers, long, new."""
    from paddlectl.studies.grouped import recency

    return not run.settings.get("unusual"), run.frames, recency(run.id)


def _notes(runs: "Sequence[RunRecord]", others: "Sequence[RunRecord]", unfinished: int) -> list[str]:
    notes = []
    if others:
        taken = {traits_of_run(run): run.settings for run in runs}
        unlike = sum(run.settings != taken[traits_of_run(run)] for run in others)
        told = f", {unlike} of them with other settings" if unlike else ""
        notes.append(
            f"runs left out: {len(others)}{told}; of a scenario, method and seed the one with the usual"
            " numbers counts, of those the longest, of those the newest"
        )
    if unfinished:
        notes.append(f"unfinished transfers left out: {unfinished}")
    return notes


def traits_of_run(run: "RunRecord") -> Traits:
    return Traits(run.scenario or run.task, run.method, run.task, str(run.seed))


def traits_of_result(result: "Result") -> Traits:
    return Traits(result.scenario, result.method, result.target, str(result.seed))


def chosen(
    items: Sequence[T],
    traits: Callable[[T], Traits],
    wanted: Mapping[str, Sequence[str]],
    where: str,
    way_to: Callable[[str], str],
) -> list[T]:
    """Those that have one of the wanted values of each trait; nothing wanted is all.

    Args:
        items: Runs or results.
        traits: Of each.
        wanted: Trait -> values.
        where: Where they are from.
        way_to: The command that brings some there, by a method if there is one of the name that it is given.

    Raises:
        NotFoundError: If there are none; with what there is, and what to run.
    """
    from paddlectl.registry.names import nearest, shown

    there = [traits(item) for item in items]
    if not there:
        raise NotFoundError(f"no finished transfer in {shown(where)}", f"run: {way_to('')}")
    for trait, names in wanted.items():
        known = sorted(
            {getattr(its, trait) for its in there}, key=lambda name: (name.isdigit() and len(name), name)
        )
        for name in names:
            if name not in known:
                told = f"no finished transfer in {shown(where)} is of {trait} {shown(name)}"
                way = way_to(name if trait == "method" else "")
                raise NotFoundError(
                    f"{told}; there are {_several(known)}", f"{nearest(name, known)}run: {way}"
                )
    found = [item for item, its in zip(items, there, strict=True) if _fits(its, wanted)]
    if not found:
        asked = ", ".join(name for names in wanted.values() for name in names)
        told = f"no finished transfer in {shown(where)} is of all of {asked}"
        raise NotFoundError(f"{told}; there are {_several(_pairs(there))}", f"run: {way_to('')}")
    return found


def _fits(traits: Traits, wanted: Mapping[str, Sequence[str]]) -> bool:
    return all(not names or getattr(traits, trait) in names for trait, names in wanted.items())


def _pairs(traits: Sequence[Traits]) -> list[str]:
    """`A by paddle`, each once."""
    return sorted({f"{its.scenario} by {its.method}" for its in traits})


def _several(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
