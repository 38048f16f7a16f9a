"""Options and arguments that several commands share, and what the shell completes for them."""

from typing import Annotated

import typer

from paddlectl.errors import UsageError
from paddlectl.registry.fields import MOST_SEEDS, SEEDS

REGISTRY = "PADDLECTL_REGISTRY"
LISTED = 50


def complete_tasks(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import task_names

    return [name for name in task_names() if name.startswith(incomplete)]


def complete_policies(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import policy_names

    return [pair for pair in policy_names(ctx.params.get("registry")) if pair[0].startswith(incomplete)]


def complete_runs(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import run_names

    return [pair for pair in run_names(ctx.params.get("registry")) if pair[0].startswith(incomplete)]


def complete_held(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import held_names

    return [pair for pair in held_names(ctx.params.get("registry")) if pair[0].startswith(incomplete)]


def complete_stopped(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    from paddlectl.cli.completion import stopped_names

    return [pair for pair in stopped_names(ctx.params.get("registry")) if pair[0].startswith(incomplete)]


def complete_scenarios(incomplete: str) -> list[str]:
    from paddlectl.cli.completion import scenario_files

    return [name for name in scenario_files(incomplete) if name.startswith(incomplete)]


AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
RegistryPlace = Annotated[
    str,
    typer.Option("--registry", envvar=REGISTRY, metavar="FOLDER", help="Where policies and runs are kept."),
]
EveryRow = Annotated[bool, typer.Option("--all", help="All of them.")]
MostRows = Annotated[
    int | None,
    typer.Option("--limit", min=1, metavar="N", help="The newest N; 50 without.", show_default=False),
]
CheckpointEvery = Annotated[
    float | None,
    typer.Option(
        "--checkpoint-every",
        min=0.0,
        metavar="SECONDS",
        help="What a killed run loses at most; 30 without.",
        show_default=False,
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", min=1, metavar="N", help="Runs at a time; as many as CPUs without.", show_default=False
    ),
]
PolicyName = Annotated[
    str,
    typer.Argument(
        metavar="POLICY",
        autocompletion=complete_policies,
        help="A policy's id, or a task's name for its best policy.",
        show_default=False,
    ),
]
OneSeed = Annotated[int | None, typer.Option("--seed", metavar="N", help="One seed.", show_default=False)]
ManySeeds = Annotated[
    str | None,
    typer.Option(
        "--seeds", metavar="N-M", help="Several: 0-5, or 0,3,7; run side by side.", show_default=False
    ),
]


def most_rows(every: bool, limit: int | None) -> int | None:
    """How many rows `--all` and `--limit` ask for; None is all.

    Raises:
        UsageError: If both are given.
    """
    if every and limit is not None:
        raise UsageError("--all and --limit exclude each other")
    return None if every else limit or LISTED


def chosen_seeds(seed: int | None, seeds: str | None, default: tuple[int, ...]) -> tuple[int, ...]:
    """The seeds that `--seed` or `--seeds` name, else the default.

    Raises:
        UsageError: If both are given, or one makes no sense.
    """
    if seed is not None and seeds is not None:
        raise UsageError("--seed and --seeds exclude each other")
    if seeds is not None:
        return parse_seeds(seeds)
    if seed is None:
        return default
    return parse_seeds(str(seed))


def parse_seeds(text: str) -> tuple[int, ...]:
    """`0-5` or `0,3,7` or both mixed, in the order written.

    Raises:
        UsageError: If it isn't that, a seed stands twice, or there are more than MOST_SEEDS.
    """
    seeds = [seed for part in text.split(",") for seed in _seed_range(part.strip(), text)]
    if len(set(seeds)) != len(seeds):
        raise UsageError(f"a seed stands twice in {text!r}")
    if len(seeds) > MOST_SEEDS:
        raise UsageError(f"more than {MOST_SEEDS} seeds in {text!r}")
    return tuple(seeds)


def _seed_range(part: str, text: str) -> range:
    first, dash, last = part.partition("-")
    numbers = (first, last) if dash else (first, first)
    if not all(number.isascii() and number.isdigit() and len(number) <= 10 for number in numbers):
        raise UsageError(f"not seeds: {text!r}", "write them as 0-5 or 0,3,7")
    low, high = int(numbers[0]), int(numbers[1])
    if low > high or high >= SEEDS:
        raise UsageError(f"not seeds: {text!r}", "the lower one first, all below 2^32")
    return range(low, high + 1)[: MOST_SEEDS + 1]
