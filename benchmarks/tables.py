"""The tables of the result files, put between the marks of docs/.

python benchmarks/tables.py
"""

import argparse
import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
Run = dict[str, Any]
WAYS = {
    "scratch": "nothing",
    "all": "all before it",
    "auto": "the three most similar",
    "random": "three by chance",
}
Column = tuple[str, Callable[[Sequence[Run]], str]]


def seeds(runs: Sequence[Run]) -> str:
    return ", ".join(str(seed) for seed in sorted(run["seed"] for run in runs))


def figure(path: str, form: str, *, less_is_better: bool) -> Callable[[Sequence[Run]], str]:
    """A cell: the median over seeds, and the worst; `–` where a seed never came there."""

    def cell(runs: Sequence[Run]) -> str:
        values = [_at(run, path) for run in runs]
        missing = float("inf") if less_is_better else float("-inf")
        known = [missing if value is None else value for value in values]
        worst = max(known) if less_is_better else min(known)
        middle = _shown(median(known), form)
        return middle if len(known) == 1 else f"{middle} ({_shown(worst, form)})"

    return cell


def _at(run: Run, path: str) -> float | None:
    found: Any = run
    for key in path.split("/"):
        found = None if found is None else found[key]
    value: float | None = found
    return value


def _shown(value: float, form: str) -> str:
    return "–" if value in (float("inf"), float("-inf")) else format(value, form)


_UNSEEN: list[Column] = [
    ("success", figure("unseen_layouts/success", ".1%", less_is_better=False)),
    ("steps ÷ shortest", figure("unseen_layouts/length_ratio", ".2f", less_is_better=True)),
]
_SOURCE: list[Column] = [
    ("seeds", seeds),
    *_UNSEEN,
    ("crisp", figure("crispness", ".2f", less_is_better=False)),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("seconds", figure("seconds", ".0f", less_is_better=True)),
]
_TRANSFER: list[Column] = [
    ("seeds", seeds),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("jump-start", figure("jump_start", ".2f", less_is_better=False)),
    ("first 200", figure("success_first_200", ".1%", less_is_better=False)),
    ("frames to 0.9", figure("to_success/0.9/frames", ",.0f", less_is_better=True)),
    ("frames to 0.97", figure("to_success/0.97/frames", ",.0f", less_is_better=True)),
    *_UNSEEN,
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
]
_RANDOM: list[Column] = [
    ("seeds", seeds),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("jump-start", figure("jump_start", ".2f", less_is_better=False)),
    ("first 200", figure("success_first_200", ".1%", less_is_better=False)),
    ("frames to 0.9", figure("to_success/0.9/frames", ",.0f", less_is_better=True)),
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
    ("area lost", figure("area_lost", ".1%", less_is_better=True)),
]

_PAPER: list[Column] = [
    ("seeds", seeds),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("jump-start", figure("jump_start", ".2f", less_is_better=False)),
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
    ("last 100", figure("final_success", ".1%", less_is_better=False)),
    ("led by the target at the end", figure("led_by_target", ".0%", less_is_better=False)),
    ("success", figure("unseen_layouts/success", ".1%", less_is_better=False)),
]

_MAZE: list[Column] = [
    ("seeds", seeds),
    ("steps of training", figure("frames", ",.0f", less_is_better=True)),
    ("success", figure("unseen_starts/success", ".1%", less_is_better=False)),
    ("score", figure("unseen_starts/mean_score", ".1f", less_is_better=False)),
    ("steps", figure("unseen_starts/mean_length", ".0f", less_is_better=True)),
    ("crisp", figure("crispness", ".2f", less_is_better=False)),
    ("first 50", figure("success_first_50", ".0%", less_is_better=False)),
    ("score, last 100", figure("score_last_100", ".1f", less_is_better=False)),
    ("CPU seconds", figure("cpu_seconds", ".0f", less_is_better=True)),
]
_CHECK: list[Column] = [
    ("seeds", seeds),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("success", figure("unseen", ".1%", less_is_better=False)),
    ("steps", figure("mean_length", ".1f", less_is_better=True)),
    ("jump-start", figure("jump_start", ".2f", less_is_better=False)),
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
    ("frames to 0.97", figure("to_success/0.97/frames", ",.0f", less_is_better=True)),
    ("seconds", figure("seconds", ".0f", less_is_better=True)),
]
_STOCK: list[Column] = [
    ("seeds", seeds),
    ("frames", figure("frames", ",.0f", less_is_better=True)),
    ("unseen success", figure("unseen_success", ".1%", less_is_better=False)),
    ("steps", figure("unseen_length", ".0f", less_is_better=True)),
    ("last 100", figure("final_success", ".0%", less_is_better=False)),
    ("frames to 0.9", figure("frames_to_success", ",.0f", less_is_better=True)),
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
]
_ABLATED = [column for column in _MAZE if column[0] not in ("steps", "crisp")]


def _slowest(bar: str) -> Callable[[Sequence[Run]], str]:
    """A cell: the subgoal that the target came to reach last in this share of its decisions, and when."""

    def cell(runs: Sequence[Run]) -> str:
        never = float("inf")
        frames = {
            subgoal: median(run["frames_to"][subgoal].get(bar, never) for run in runs)
            for subgoal in runs[0]["frames_to"]
        }
        last = max(frames.values())
        names = ", ".join(f"`{name.removesuffix('()')}`" for name in frames if frames[name] == last)
        return f"never: {names}" if last == never else f"{last:,.0f}: {names}"

    return cell


_WHY: list[Column] = [
    ("seeds", seeds),
    ("area", figure("area_under_curve", ".2f", less_is_better=False)),
    ("led by guides", figure("guided", ".0%", less_is_better=False)),
    ("of it missed", figure("guided_and_missed", ".0%", less_is_better=True)),
    ("of it unsolved", figure("guided_and_unsolved", ".0%", less_is_better=True)),
    ("slowest subgoal to 0.5", _slowest("0.5")),
    ("to 0.9", _slowest("0.9")),
]


RIVAL = "hdm"
SCENARIOS = ("A", "B", "C", "D", "A-place", "B-place", "C-place", "D-place")
RESAMPLES = 20_000


def compared(results: Run) -> str:
    """Markdown: `paddle` beside its rivals, scenario by scenario, seed by seed; what the intervals bear."""
    by_name: dict[tuple[str, str, str | None], dict[int, float]] = {}
    for run in results["runs"].values():
        if run["kind"] == "transfer":
            key = run["method"], run["task"], run["scenario"]
            by_name.setdefault(key, {})[run["seed"]] = run["area_under_curve"]
    rows = [["scenario", "seeds", "`paddle`", f"`{RIVAL}`", "difference", "P(improvement)", "`paddle` is"]]
    for (method, task, scenario), ours in sorted(by_name.items(), key=str):
        theirs = by_name.get((RIVAL, task, None), {})
        seeds = sorted(ours.keys() & theirs.keys())
        if method == "paddle" and scenario in SCENARIOS and seeds:
            x, y = (np.array([found[seed] for seed in seeds]) for found in (ours, theirs))
            rows.append([str(scenario), str(len(seeds)), *_difference(x, y)])
    return _markdown(rows) if len(rows) > 1 else ""


def _difference(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> list[str]:
    """Means, paired difference and P(improvement) with 95 % bootstrap intervals over seeds, and a verdict."""
    rng, n = np.random.default_rng(0), len(ours)
    drawn = rng.integers(n, size=(RESAMPLES, n))
    differences = (ours - theirs)[drawn].mean(-1)
    better = _improvement(ours[drawn], theirs[rng.integers(n, size=(RESAMPLES, n))])
    low, high = np.quantile(differences, (0.025, 0.975))
    worst, best = np.quantile(better, (0.025, 0.975))
    verdict = "ahead" if worst > 0.5 else "behind" if best < 0.5 else "level"
    return [
        f"{ours.mean():.2f}",
        f"{theirs.mean():.2f}",
        f"{(ours - theirs).mean():+.2f} [{low:+.2f}, {high:+.2f}]",
        f"{_improvement(ours[None], theirs[None])[0]:.2f} [{worst:.2f}, {best:.2f}]",
        verdict,
    ]


def _improvement(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of all pairs of runs in which ours has more; a tie counts half. [n, S], [n, S] -> [n]"""
    pairs = np.sign(ours[:, :, None] - theirs[:, None, :])
    share: NDArray[np.float64] = (0.5 + 0.5 * pairs).mean((1, 2))
    return share


def tables(results: Run) -> str:
    """Markdown: the sources, what was learned of the targets, that with random sources, how to read it."""
    runs = results["runs"].values()
    sources = [run for run in runs if run["kind"] == "source"]
    papers = [run for run in runs if run["guidance"] == "paper"]
    transfers = [
        run for run in runs if run["kind"] == "transfer" and "area_lost" not in run and run not in papers
    ]
    randoms = [run for run in runs if "area_lost" in run]
    parts = [
        table("source", _SOURCE, grouped(sources, lambda run: run["task"])),
        table("target and method", _TRANSFER, grouped(transfers, _what)),
        table("with random sources added", _RANDOM, grouped(randoms, _what)),
        table("`guidance: paper`", _PAPER, grouped(papers, _reading_of_paper)),
        _reading(list(runs)),
    ]
    return "\n\n".join(part for part in parts if part)


def why_table(runs: Sequence[Run]) -> str:
    """Markdown: what guides led, and what the target learned meanwhile."""
    return table(
        "scenario, episodes", _WHY, grouped(runs, lambda run: f"{run['scenario']}, {run['episodes']}")
    )


def maze_tables(results: Run) -> str:
    """Markdown: what was learned in the maze, each setting taken back by itself, how to read it."""
    runs = [{"name": key.rpartition(" seed ")[0], **run} for key, run in results["runs"].items()]
    ablated = [run for run in runs if run["name"].startswith("without ")]
    learned = [run for run in runs if run not in ablated]
    parts = [
        table("learned", _MAZE, grouped(learned, lambda run: run["name"])),
        table("by itself", _ABLATED, grouped(ablated, _taken_back)),
        "Median over seeds (the worst seed in brackets). Success, score and steps: 200 starts never trained "
        "on, failures at 1000 steps. First 50: success over the first 50 episodes started. Score, last 100: "
        "over the last 100 episodes of training, whoever led. "
        f"{'; '.join(_machines(runs))}; {', '.join(_versions(runs))}; {results['written'][:10]}.",
    ]
    return "\n\n".join(part for part in parts if part)


def check_tables(results: Run) -> str:
    """Markdown: how each method fares where it has to learn, and what it has without its source."""
    runs = [{"name": key.rpartition(" seed ")[0], **run} for key, run in results["runs"].items()]
    told = (
        "Median over seeds (the worst seed in brackets). Success and steps: 200 layouts or starts never "
        "trained on. Jump-start and area as in the glossary; frames to 0.97 as on the page of measurements. "
        "Seconds: one process of two side "
        f"by side, on a machine with other work. Commit {', '.join(sorted({r['commit'] for r in runs}))}; "
        f"{'; '.join(_machines(runs))}; {', '.join(_versions(runs))}; {results['written'][:10]}."
    )
    return f"{table('check', _CHECK, grouped(runs, lambda run: run['name']))}\n\n{told}"


def stock_table(results: Sequence[Run], theirs: Sequence[Run]) -> str:
    """Markdown: MiniGrid's own targets by transfer and from scratch, and by SB3's PPO."""
    ours = [{"name": f"{run['scenario']}, `{run['method']}`", **run} for run in results]
    scenario_of = {run["target"]: run["scenario"] for run in results}
    lacking = dict.fromkeys(("unseen_success", "unseen_length", "frames_to_success", "area_under_curve"))
    others = [
        {
            "name": f"{scenario_of[run['task']]}, SB3's PPO",
            **lacking,
            "final_success": run["latest_success"],
            **run,
        }
        for run in theirs
    ]
    return table("target, method", _STOCK, grouped([*ours, *others], lambda run: run["name"]))


def curriculum_table(results: Sequence[Run], budget: int = 100_000) -> str:
    """Markdown: twelve tasks in a row, by what each reuses; the first, which reuses none, isn't counted."""
    rows = [["each task reuses", "seeds", "area", "frames to 0.9", "never", "unseen success", "forgotten"]]
    for way, told in WAYS.items():
        runs = [run for run in results if run["way"] == way and run["place"]]
        by_seed = [[run for run in runs if run["seed"] == seed] for seed in sorted({r["seed"] for r in runs})]
        frames = [[run["frames_to_success"] or budget for run in row] for row in by_seed]
        rows.append(
            [
                told,
                str(len(by_seed)),
                _spread([np.mean([run["area_under_curve"] for run in row]) for row in by_seed], ".3f"),
                _spread([np.mean(row) for row in frames], ",.0f"),
                str(sum(run["frames_to_success"] is None for run in runs)),
                f"{np.mean([run['unseen_success'] for run in runs]):.1%}",
                str(sum(run["success_at_the_end"] < run["unseen_success"] for run in runs)),
            ]
        )
    return _markdown(rows)


def cost_table(results: Run) -> str:
    """Markdown: what a transfer costs, by the number of its sources."""
    rows = [["sources", "frames a second", "CPU seconds", "MB"]]
    for row in results["transfers"]:
        name = str(row["sources"]) if row["sources"] else "none (`hdm`)"
        rows.append(
            [name, f"{row['frames_per_second']:,.0f}", f"{row['cpu']:.0f}", f"{row['megabytes']:,.0f}"]
        )
    return f"{_markdown(rows)}\n\nOf {results['frames']:,} frames, start and evaluation included."


def start_table(results: Run) -> str:
    """Markdown: how long commands take in a registry of many runs."""
    rows = [["command", "seconds", "CPU seconds"]]
    rows += [
        [f"`{line}`" if line[0] != "b" else line, f"{row['wall']:.2f}", f"{row['cpu']:.2f}"]
        for line, row in results["seconds"].items()
    ]
    return _markdown(rows)


def scale_table(results: Run) -> str:
    """Markdown: the same as the registry grows, with memory."""
    sizes = [str(size) for size in results["sizes"]]
    rows = [["what", *(f"{int(size):,}" for size in sizes), "MB at the largest"]]
    for name, by_size in results["rows"].items():
        told = [by_size[size] for size in sizes]
        cells = [f"{row['wall']:.2f} s" if "wall" in row else "" for row in told]
        rows.append([name, *cells, f"{told[-1]['megabytes']:,.0f}" if "megabytes" in told[-1] else ""])
    return _markdown(rows)


def _spread(values: Sequence[Any], form: str) -> str:
    """The mean over seeds, and their range."""
    return f"{np.mean(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def _taken_back(run: Run) -> str:
    return f"{run['task']}, {run['name'].removesuffix(run['task']).strip()}"


def _machines(runs: Sequence[Run]) -> list[str]:
    return sorted({f"{run['machine']['cpu']}, {run['machine']['cores']} cores" for run in runs})


def _versions(runs: Sequence[Run]) -> list[str]:
    return sorted({f"PyTorch {run['versions']['torch']}" for run in runs})


def _what(run: Run) -> str:
    of = (
        f"`{run['method']}`, scenario {run['scenario']}" if run["scenario"] else f"`{run['method']}`, scratch"
    )
    return f"{run['task']}, {of}"


def _reading_of_paper(run: Run) -> str:
    scenario, _, reading = run["scenario"].partition(", ")
    return f"scenario {scenario}, " + {"paper": "as it is", "letter": "by the letter"}[reading]


def grouped(runs: Iterable[Run], name: Callable[[Run], str]) -> dict[str, list[Run]]:
    """The runs of each name, the names in order."""
    groups: dict[str, list[Run]] = {}
    for run in sorted(runs, key=name):
        groups.setdefault(name(run), []).append(run)
    return groups


def table(title: str, columns: Sequence[Column], groups: dict[str, list[Run]]) -> str:
    """Markdown: a row for each group; nothing if there is none."""
    if not groups:
        return ""
    rows = [[title, *(name for name, _ in columns)]]
    rows += [[name, *(cell(runs) for _, cell in columns)] for name, runs in groups.items()]
    return _markdown(rows)


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def _reading(runs: Sequence[Run]) -> str:
    days = sorted({run["finished"][:10] for run in runs})
    if not runs:
        return "No runs yet."
    lost = (
        "Area lost: of what the same scenario and seed has without the random sources. "
        if any("area_lost" in run for run in runs)
        else ""
    )
    return (
        "Median over seeds (the worst seed in brackets). Success and steps: 200 layouts never trained on, "
        "failures at 320 steps; the shortest plans of the same layouts are found by search. Jump-start: mean "
        "score of the first 100 episodes started; first 200: success over the first 200 started. Frames to "
        "0.9: until 100 episodes that started one after another had ended with that success. Area: mean, "
        "over the frames of the run, of the score of the latest 100 episodes that had started. Last 100: "
        "success over the last 100 in the order of their start. Led by the target at the end: share of its "
        f"decisions in the last tenth of the run or a little more. {lost}Seconds: one process of two side "
        "by side, one thread each. "
        f"{'; '.join(_machines(runs))}; {', '.join(_versions(runs))}; "
        f"{' to '.join(dict.fromkeys((days[0], days[-1])))}."
    )


MADE: dict[str, Callable[[Any], str]] = {
    "curriculum": curriculum_table,
    "many_sources": cost_table,
    "start_up": start_table,
    "scale": scale_table,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=HERE / "learning.json")
    parser.add_argument("--maze", type=Path, default=HERE / "maze.json")
    parser.add_argument("--sanity", type=Path, default=HERE / "sanity.json")
    parser.add_argument("--why", type=Path, default=HERE / "why.json")
    parser.add_argument("--guidance", type=Path, default=HERE.parent / "docs" / "guidance.md")
    parser.add_argument("--page", type=Path, default=HERE.parent / "docs" / "benchmarks.md")
    parser.add_argument("--environments", type=Path, default=HERE.parent / "docs" / "environments.md")
    parser.add_argument("--methods", type=Path, default=HERE.parent / "docs" / "methods.md")
    options = parser.parse_args()
    text = options.page.read_text()
    text = _put(text, "results", tables(json.loads(options.results.read_text())))
    text = _put(text, "compared", compared(json.loads(options.results.read_text())))
    text = _put(text, "maze", maze_tables(json.loads(options.maze.read_text())))
    for mark, made in MADE.items():
        if (path := HERE / f"{mark}.json").exists():
            text = _put(text, mark, made(json.loads(path.read_text())))
    options.page.write_text(text)
    stock = [json.loads((HERE / "minigrid" / name).read_text()) for name in ("stock.json", "sb3.json")]
    options.environments.write_text(_put(options.environments.read_text(), "stock", stock_table(*stock)))
    if options.why.exists():
        why = why_table(json.loads(options.why.read_text())["runs"])
        options.guidance.write_text(_put(options.guidance.read_text(), "why", why))
    if options.sanity.exists():
        checks = check_tables(json.loads(options.sanity.read_text()))
        options.methods.write_text(_put(options.methods.read_text(), "checks", checks))


def _put(text: str, mark: str, made: str) -> str:
    """The text with what was made between its marks."""
    marked = re.compile(rf"(<!-- {mark} -->\n).*?(<!-- /{mark} -->)", re.DOTALL)
    if not marked.search(text):
        raise SystemExit(f"the text has no lines <!-- {mark} --> and <!-- /{mark} -->")
    return marked.sub(lambda marks: f"{marks[1]}{made}\n{marks[2]}", text)


if __name__ == "__main__":
    main()
