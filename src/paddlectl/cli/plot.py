"""`paddlectl plot`."""

import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from paddlectl import shipped
from paddlectl.cli.options import (
    AsJson,
    ManySeeds,
    RegistryPlace,
    StudyFrames,
    TaskFiles,
    at_home,
    chosen_seeds,
    complete_plotted,
    file_at,
)
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.fields import LABEL
from paddlectl.registry.names import quoted

if TYPE_CHECKING:
    from paddlectl.registry.records import RunRecord
    from paddlectl.report.panels import Panel

EXAMPLE = "Example: paddlectl plot run-42 --to figures"
CAPTION = "interquartile mean over n seeds, and its 95 % bootstrap interval"
BARS = 40

_LIKE_RUN = re.compile(r"(run|policy)?[^\w./]*[0-9]*", re.IGNORECASE)


def plot(
    what: Annotated[
        str,
        typer.Argument(
            metavar="FILE.yaml|NAME|FILE.json|RUN",
            autocompletion=complete_plotted,
            help="A study, as sweep takes it, results of one, or a run's id or name; or latest.",
            show_default=False,
        ),
    ],
    to: Annotated[
        Path, typer.Option(parser=file_at, metavar="FOLDER", help="Where the figure is written.")
    ] = Path("figures"),
    x: Annotated[
        Literal["frames", "episodes"], typer.Option(help="What the scores are drawn over.")
    ] = "frames",
    seeds: ManySeeds = None,
    frames: StudyFrames = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Draw a study's figure, or a run's curve, as SVG and PNG with the numbers as CSV."""
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import clean, print_json, print_text
    from paddlectl.report.plots import require_matplotlib, write_figure
    from paddlectl.report.run_panels import run_panels
    from paddlectl.report.sparkline import sparkline

    if to.exists() and not to.is_dir():
        raise UsageError(f"{to} is not a folder", "name another: --to FOLDER")
    require_matplotlib()
    told = []
    if not _is_run(what, registry):
        name, caption = Path(what).stem, CAPTION
        panels = _panels(at_home(what), registry, x, seeds, frames)
        if not panels:
            raise UsageError(f"no run of {what} is long enough to have a curve", "give more --frames")
    else:
        opened = Registry.open(registry, create=False)
        record = opened.run(what)
        name, caption = record.id, ""
        panels = run_panels(opened, record, x)
        scores = panels[0].series[0].mid
        told = [f"score {sparkline(scores, BARS, sys.stdout.encoding)} {scores[-1]:.2f}"]
    name = name if x == "frames" else f"{name}-{x}"
    try:
        files = write_figure(panels, to, name, caption)
    except OSError as error:
        raise UsageError(
            f"nothing can be written in {to}: {error.strerror}", "name another: --to FOLDER"
        ) from error
    if as_json:
        print_json({"figure": name, **{kind: str(path) for kind, path in files.items()}})
    else:
        print_text([*told, *(clean(path) for path in files.values())])


def _is_run(what: str, location: str) -> bool:
    """Whether it is a run's id or name, or near one; a study or file of that name goes before."""
    from paddlectl.registry.names import LATEST, nearest
    from paddlectl.registry.store import Registry

    if _LIKE_RUN.fullmatch(what) or what == LATEST:
        return True
    if not re.fullmatch(LABEL, what) or what in shipped.studies() or Path(what).is_file():
        return False
    with suppress(NotFoundError), Registry.open(location, create=False) as opened:
        known = opened.run_names(what)
        return opened.run_called(what) is not None or bool(nearest(what, known, 0.85))
    return False


def _panels(what: str, registry: str, x: str, seeds: str | None, frames: int | None) -> "list[Panel]":
    """Those of a study's finished cells, or of the results in a file.

    Raises:
        NotFoundError: If there is no such file, or no result.
        UsageError: If it is neither a study nor results by its name, or its cells can't be chosen.
    """
    from paddlectl.report.panels import panels_of
    from paddlectl.studies.results import read_results

    path = shipped.study(what)
    match path.suffix.lower():
        case ".yaml" | ".yml":
            return _panels_of_study(what, registry, x, seeds, frames)
        case ".json" if seeds is None and frames is None:
            if results := read_results(_file(path)):
                return panels_of(results, x)
            raise NotFoundError(f"no results in {path}")
        case ".json":
            raise UsageError("--seeds and --frames choose cells of a study (.yaml)", "leave them out")
    raise UsageError(f"{path} is neither a study (.yaml) nor results (.json)", "run: paddlectl plot --help")


def _panels_of_study(
    what: str, registry: str, x: str, seeds: str | None, frames: int | None
) -> "list[Panel]":
    from paddlectl.registry.store import Registry
    from paddlectl.report.panels import panels_of
    from paddlectl.report.weight_panels import weight_panels
    from paddlectl.studies.cells import cells_of
    from paddlectl.studies.study import load_study
    from paddlectl.studies.sweep import finished, results_of

    loaded = load_study(shipped.study(what))
    cells = cells_of(loaded, chosen_seeds(None, seeds, loaded.study.seeds), frames)
    opened = Registry.open(registry, create=False)
    runs = finished(opened, cells)
    if not runs:
        raise NotFoundError(f"no results in {what}", f"run: paddlectl sweep {quoted(what)} --dry-run")
    if loaded.study.figure == "curves":
        return panels_of(results_of(opened, runs), x)
    of_scenarios: dict[str, list[RunRecord]] = {}
    for cell, run in runs:
        of_scenarios.setdefault(cell.panel, []).append(run)
    return weight_panels(opened, of_scenarios)


def _file(path: Path) -> Path:
    from paddlectl.registry.names import nearest

    if path.is_file():
        return path
    beside = path.parent.glob("*.json") if path.parent.is_dir() else ()
    near = nearest(path.name, [other.name for other in beside])
    raise NotFoundError(f"no file {path}", f"{near}run: paddlectl plot --help")
