"""docs/results.md, written from the results of the paper's studies in benchmarks/paper/.

    make paper                 runs what is missing of the studies, then this
    python benchmarks/paper.py

A table for each study: of each scenario and method the figures with their 95 % intervals over seeds, then
PADDLE against each other one. Nothing in it is written by hand but the studies' first comments.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from paddlectl.studies.cells import cells_of
from paddlectl.studies.comparison import comparison_document
from paddlectl.studies.results import Result, read_results
from paddlectl.studies.study import load_study

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "paper"
STUDIES = ROOT / "scenarios" / "paper"
PAGE = ROOT / "docs" / "results.md"
README = ROOT / "README.md"
HEADLINE = "fig4"
ORDER = ("fig3", "fig4", "fig5", "fig6a", "fig6b", "ablation-weights", "ablation-rules", "ablation-paper")
AREA = "area_under_curve"
SIGNS = {"ahead": "**ahead**", "behind": "**behind**"}
Document = dict[str, Any]


def main() -> None:
    parts = [
        part for name in ORDER for part in (study(name) if done(name) == cells(name) else unfinished(name))
    ]
    PAGE.write_text("\n\n".join([*head(), *parts]) + "\n", encoding="utf-8")
    if done(HEADLINE) == cells(HEADLINE):
        text = README.read_text(encoding="utf-8")
        before, rest = text.split("<!-- headline -->\n")
        _, after = rest.split("<!-- /headline -->")
        made = headline(comparison_document(read_results(RESULTS / f"{HEADLINE}.json")))
        README.write_text(f"{before}<!-- headline -->\n{made}\n<!-- /headline -->{after}", encoding="utf-8")


def cells(name: str) -> int:
    """How many transfers a study has."""
    return len(cells_of(load_study(STUDIES / f"{name}.yaml")))


def done(name: str) -> int:
    """How many of them have a result."""
    path = RESULTS / f"{name}.json"
    return len(read_results(path)) if path.exists() else 0


def unfinished(name: str) -> Iterator[str]:
    """What stands for a study that isn't whole: no figure of it says anything yet."""
    yield f"## {name}"
    yield f"{purpose(name)} {done(name)} of {cells(name)} transfers are there, so there is no result yet."


def purpose(name: str) -> str:
    """The first comment of a study's file."""
    first = (STUDIES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()[0]
    return first.removeprefix("# ")


def head() -> Iterator[str]:
    yield "# Results"
    yield (
        "The studies of `scenarios/paper/`. `make paper` runs what is missing of them and writes this "
        "page from `benchmarks/paper/`; `paddlectl compare benchmarks/paper/fig4.json` shows the same in "
        "a terminal, with every figure. Seeds are paired: a transfer reuses sources of its own seed. "
        "Area, jump-start and final score are explained in the [glossary](glossary.md); here they are "
        "interquartile means over seeds with 95 % intervals, bold where they are the best or not told "
        "apart from it. *Unseen* is the share of 200 layouts that no training uses which the worst seed's"
        " policy solves, *steps* the mean length of those episodes, *sources* the frames that training "
        "the sources took, which count for no method. Environments begin their first episodes together, "
        "and an episode that isn't solved lasts to the horizon; so at first curves rise in steps. P is the "
        "probability that PADDLE does better than "
        "the other one; it is said to be ahead or behind only where its whole interval is above or below "
        "0.5."
    )


def headline(document: Document) -> str:
    """The areas under the curve alone, a row a scenario: interquartile means over seeds."""
    best = {each["scenario"]: each["labels"] for each in document["best"] if each["figure"] == AREA}
    rows: dict[str, list[str]] = {}
    for cell in document["cells"]:
        value = f"{cell[AREA]['iqm']['value']:.2f}"
        row = rows.setdefault(cell["scenario"], [cell["scenario"]])
        row.append(_bold(value, cell["label"] in best[cell["scenario"]]))
    return _table(("scenario", *(f"`{label}`" for label in document["labels"])), rows.values())


def study(name: str) -> Iterator[str]:
    """A study's part of the page."""
    results = read_results(RESULTS / f"{name}.json")
    document = comparison_document(results)
    yield f"## {name}"
    yield f"{purpose(name)} {_made_by(results)}"
    yield _table(
        (
            "scenario",
            "method",
            "n",
            "area",
            "jump-start",
            "final",
            "frames to 0.9",
            "unseen",
            "steps",
            "sources",
        ),
        _cells(document, results),
    )
    if rows := list(_against(document)):
        of = document["of"]
        yield f"`{of}` against the others, by area under the curve and by jump-start:"
        yield _table(
            ("scenario", "other", "P, area", "difference", "", "P, jump-start", "difference", ""), rows
        )
    yield "\n".join(f"- {note}" for note in [*document["verdicts"][AREA], *document["notes"]])


def _made_by(results: Sequence[Result]) -> str:
    runs = {result.cell or result.run: result for result in results}.values()
    frames = sorted({run.frames for run in runs})
    hours = sum(run.seconds for run in runs) / 3600
    return (
        f"{len(runs)} runs of {frames[0]:,} to {frames[-1]:,} frames, {hours:.1f} hours of one core, by "
        f"paddlectl {' and '.join(sorted({run.code for run in runs}))}."
    )


def _cells(document: Document, results: Sequence[Result]) -> Iterator[tuple[str, ...]]:
    """The best of a scenario, and what isn't told apart from it, in bold."""
    best = {(each["scenario"], each["figure"]): each["labels"] for each in document["best"]}
    for cell in document["cells"]:
        runs = [
            run
            for run in results
            if (run.scenario, run.method, run.variant) == (cell["scenario"], cell["method"], cell["variant"])
        ]
        figures = [
            _bold(_estimate(cell[figure]["iqm"]), cell["label"] in best[cell["scenario"], figure])
            for figure in (AREA, "jump_start", "final_score")
        ]
        reached = cell["frames_to_success"]["median"]["value"]
        yield (
            cell["scenario"],
            f"`{cell['label']}`",
            str(cell["n"]),
            *figures,
            "never" if reached is None or reached == float("inf") else f"{reached:,.0f}",
            f"{100 * min(run.unseen_success for run in runs):.1f} %",
            f"{sum(run.unseen_length for run in runs) / len(runs):.1f}",
            "–" if cell["source_frames"] is None else f"{cell['source_frames']:,}",
        )


def _against(document: Document) -> Iterator[tuple[str, ...]]:
    for row in document["against"]:
        told = []
        for figure in (AREA, "jump_start"):
            versus = row[figure]
            told += [
                _estimate(versus["probability_of_improvement"]),
                _estimate(versus["difference"], sign="+"),
                SIGNS.get(versus["verdict"], versus["verdict"]),
            ]
        yield (row["scenario"] or "over all", f"`{row['label']}`", *told)


def _estimate(estimate: Document | None, sign: str = "") -> str:
    if estimate is None or estimate["value"] is None:
        return "–"
    if estimate["low"] is None:
        return f"{estimate['value']:{sign}.2f}"
    return f"{estimate['value']:{sign}.2f} [{estimate['low']:{sign}.2f}, {estimate['high']:{sign}.2f}]"


def _bold(text: str, wanted: bool) -> str:
    return f"**{text}**" if wanted else text


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main()
