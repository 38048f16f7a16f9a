"""PADDLE with one of its rules switched off at a time; writes a JSON result and prints a table.

The sources are those that learning.py has trained in the same registry:

    python benchmarks/learning.py --parts sources
    python benchmarks/ablations.py --scenarios A --rules none fading paper --seeds 10 11 12
    python benchmarks/ablations.py --scenarios B-place --rules none practice --frames 150000

What switching a rule off means:

"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from learning import HERE, SEEDS, Result, collected, run, scenario_of, sources_of
from readme_table import Column, figure, grouped, seeds, table

from paddlectl.experiments.jobs import TransferJob
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Guidance
from paddlectl.transfer.guidance import GuidanceSettings

ABLATION = ", ablation "
"""Stands in a run's scenario between its name and the rule, so that it isn't taken for a run as usual."""


@dataclass(frozen=True)
class Ablation:
    """What it means, and what differs from a run as usual."""

    meaning: str
    rules: dict[str, float] = field(default_factory=dict)
    changes: dict[str, Any] = field(default_factory=dict)
    guidance: Guidance = field(default_factory=Guidance)


# What the text of the paper alone would give, by itself beside the other readings, and all of it at once.
LETTER: dict[str, dict[str, Any]] = {
    "initial_performance": {"initial_performance": 1.0},
    "normalise": {"normalise": "clip"},
    "failure_cost": {"failure_cost": 0.0},
    "values": {"values": "per_guide"},
    "source_softness": {"source_softness": 0.0},
    "imitation_margin": {"imitation_margin": 0.0},
    "num_envs": {"num_envs": 64},
}
LETTER["letter"] = {name: value for reading in LETTER.values() for name, value in reading.items()}
LETTER = {name: {"mode": "paper", **reading} for name, reading in LETTER.items()}

# By their names in ablations.json. `trials` and `bandit_prior` are no rules of their own: they say when
# another applies.
RULES = {
    "none": Ablation("nothing is off"),
    "fading": Ablation("a source's Λ is its ψ for ever, whatever came of it", {"similarity_decay": 1.0}),
    "first_guess": Ablation(
        "ψ counts until a source's first decision; from then on Φ alone", {"similarity_decay": 0.0}
    ),
    "curiosity": Ablation(
        "the target's Λ has no floor: it explores only where all sources are dropped or penalised",
        {"target_floor": 0.0},
    ),
    "least_reached": Ablation("no source is dropped, however rarely it arrives", {"drop_below_success": 0.0}),
    "repeat_penalty": Ablation("to ask a guide for the same again costs nothing", {"repeat_penalty": 0.0}),
    "guided": Ablation("guides are asked in every episode", {"episodes": "guided"}),
    "alone": Ablation("guides are asked in none", {"episodes": "alone"}),
    "target_samples": Ablation("its first decision in a scene measures the target", {"target_samples": 0.0}),
    "program": Ablation("the target's program starts anew", {"program_inheritance": 0.0}),
    "shaping": Ablation(
        "the low level isn't told whether it comes nearer", changes={"decisions": {"shaping": 0.0}}
    ),
    "max_steps": Ablation(
        "a decision takes 50 steps at most", changes={"decisions": {"max_steps": 50, "patience": 0.3}}
    ),
    "patience": Ablation(
        "a source gets as many steps as the target", changes={"decisions": {"patience": 1.0}}
    ),
    "inheritance": Ablation("the target's low level starts anew", {"inheritance": 0.0}),
    "weakening": Ablation("it inherits its source's preferences at full strength", {"inheritance": 1.0}),
    "target_margin": Ablation(
        "to take over, the target must be better than every source", {"target_margin": 0.0}
    ),
    "source_memory": Ablation("a source's return is over all of its decisions", {"source_memory": 1e9}),
    "target_memory": Ablation("the target's return is over all of its decisions", {"target_memory": 1e9}),
    "planned_credit": Ablation(
        "clause weights learn from Monte-Carlo returns, as in the paper",
        changes={"credit": {"planned": False}},
    ),
    "block": Ablation("an update every 64 steps", changes={"rollout_steps": 64}),
    "fourth_epoch": Ablation("three passes over each block", changes={"low_level": {"epochs": 3}}),
    "paper": Ablation("all rules of guidance are off: Λ = ψ + Φ", guidance=Guidance(mode="paper")),
    **{
        f"paper_{name}": Ablation(f"the same, and {name} as the letter has it", guidance=Guidance(**letter))
        for name, letter in LETTER.items()
    },
}
COLUMNS: list[Column] = [
    ("seeds", seeds),
    ("jump-start", figure("jump_start", ".2f", less_is_better=False)),
    ("first 200", figure("success_first_200", ".1%", less_is_better=False)),
    ("frames to 0.9", figure("to_success/0.9/frames", ",.0f", less_is_better=True)),
    ("area", figure("area_under_curve", ".3f", less_is_better=False)),
    ("final success", figure("final_success", ".1%", less_is_better=False)),
]


def jobs_of(options: argparse.Namespace, registry: Registry) -> Iterator[TransferJob]:
    """Seed by seed, so that what is stopped early has something of every rule.

    Raises:
        NotFoundError: If a source has no policy yet.
    """
    for seed in options.seeds:
        for name in options.scenarios:
            plain = scenario_of(name)
            sources = sources_of(registry, plain, seed)
            for rule in options.rules:
                off = RULES[rule]
                told = {"name": f"{plain.name}{ABLATION}{rule}", "guidance": off.guidance}
                scenario = plain.model_copy(update=told)
                rules = GuidanceSettings(**off.rules)
                yield TransferJob(scenario, sources, "paddle", seed, options.frames, rules, off.changes)


def shown(results: Result) -> str:
    """The table: scenario by scenario, the rules in the order above."""
    groups = grouped(results["runs"].values(), lambda run: run["scenario"])
    ordered = sorted(groups, key=_place)
    return table("rule off", COLUMNS, {name.replace(ABLATION, ": "): groups[name] for name in ordered})


def _place(scenario: str) -> tuple[str, int]:
    name, rule = scenario.split(ABLATION)
    return name, list(RULES).index(rule) if rule in RULES else len(RULES)


def _ours(record: RunRecord) -> bool:
    return ABLATION in (record.scenario or "")


def parsed() -> argparse.Namespace:
    meanings = "\n".join(f"    {rule:17} {off.meaning}" for rule, off in RULES.items())
    parser = argparse.ArgumentParser(
        description=f"{__doc__}{meanings}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=["A", "C"], help="names of files in scenarios/")
    parser.add_argument("--rules", nargs="*", choices=RULES, default=list(RULES), help="to switch off")
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--frames", type=int, default=60_000, help="of every run")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--registry", default="build/bench", help="where the sources are, and runs are kept")
    parser.add_argument("--output", type=Path, default=HERE / "ablations.json", help="the result file")
    parser.add_argument("--collect", action="store_true", help="take in the registry's earlier runs too")
    return parser.parse_args()


def main() -> None:
    options = parsed()
    registry = Registry.open(options.registry)
    with collected(options, registry, _ours, shown):
        run(list(jobs_of(options, registry)), options.registry, options.workers)


if __name__ == "__main__":
    main()
