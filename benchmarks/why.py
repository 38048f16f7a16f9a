"""Why guides pay in one scenario and cost in another: what each target learned under them, and when.

For each way to lead (`GuidanceSettings.episodes`): the share of frames that guides led, and of these the
share in decisions that missed their subgoal and in episodes that weren't solved; and for each subgoal of the
target, after how many frames its own low level reached it in half and in nine of ten of the latest 50
decisions that it led. A subgoal that had nothing to act on isn't counted. The sources are those that
learning.py has trained in the same registry, of the seed of each run:

    python benchmarks/learning.py --parts sources
    python benchmarks/why.py --scenarios A C-place
"""

import argparse
import json
from collections import deque
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from learning import BUDGETS, HERE, commit, machine, scenario_of, sources_of
from tables import why_table

from paddlectl.registry.store import Registry

BARS = (0.5, 0.9)
LATEST = 50
SEEDS = (10, 11, 12)
WAYS = ("guided", "alone", "bandit")
Result = dict[str, Any]


class Ledger:
    """Takes down what came of every decision, beside who learns from it."""

    def __init__(self, agent: Any, subgoals: Sequence[Any]) -> None:
        self.frames = 0
        self.guided = self.missed = self.unsolved = 0
        self.passed: dict[str, dict[str, int]] = {}
        self.tried = {str(subgoal): 0 for subgoal in subgoals}
        self._of_domain = [str(subgoal) for subgoal in agent.learner.task.domain_subgoals]
        self._latest: dict[str, deque[bool]] = {name: deque(maxlen=LATEST) for name in self._of_domain}
        self._in_episode: dict[int, int] = {}
        self._learns = agent.credit.on_decision_end
        agent.credit.on_decision_end = self.on_decision_end

    def on_decision_end(self, outcome: Any) -> None:
        self._learns(outcome)
        columns = (outcome.lanes, outcome.subgoals, outcome.guides, outcome.steps, outcome.reached)
        for lane, subgoal, guide, steps, reached, cut, done, solved in zip(
            *columns, outcome.cut, outcome.done, outcome.terminated, strict=True
        ):
            self.frames += int(steps)
            if guide:
                self.guided += int(steps)
                self.missed += int(steps) * (not reached)
                self._in_episode[lane] = self._in_episode.get(lane, 0) + int(steps)
            elif not cut and (reached or steps > 1):
                self._own(self._of_domain[subgoal], bool(reached))
            if done:
                self.unsolved += self._in_episode.pop(lane, 0) * (not solved)

    def _own(self, subgoal: str, reached: bool) -> None:
        latest = self._latest[subgoal]
        latest.append(reached)
        self.tried[subgoal] = self.tried.get(subgoal, 0) + 1
        for bar in BARS:
            if len(latest) == LATEST and sum(latest) >= bar * LATEST:
                self.passed.setdefault(subgoal, {}).setdefault(str(bar), self.frames)


def learned(registry: str, frames: int | None, job: tuple[str, str, int]) -> Result:
    """One run of `paddle`, and its ledger."""
    from dataclasses import replace

    import numpy as np
    import torch

    from paddlectl.agents.interaction import Learning
    from paddlectl.experiments.curves import LearningCurve
    from paddlectl.experiments.runner import _source
    from paddlectl.methods.base import Setup
    from paddlectl.methods.paddle import PADDLE
    from paddlectl.tasks.suite import load

    torch.set_num_threads(1)
    name, way, seed = job
    scenario = scenario_of(name)
    task, opened = load(scenario.target), Registry.open(registry)
    budget = frames or BUDGETS[task.name]
    settings = PADDLE.settings_for(task, scenario)
    rules = replace(PADDLE.rules_for(task), episodes=way)
    sources = tuple(_source(opened, policy) for policy in sources_of(opened, scenario, seed))
    agent = PADDLE.make(Setup(task, settings, seed, budget, sources, scenario, rules))
    ledger = Ledger(agent, task.subgoals)
    layouts = np.random.SeedSequence(seed).spawn(1)[0]
    environment = task.make(settings.num_envs, int(layouts.generate_state(1)[0]), settings.action_repeat)
    episodes = []
    for round_ in Learning(environment, agent, budget):
        agent.record(round_.frames, round_.episodes, 0)
        episodes += round_.episodes
    return {
        "scenario": name,
        "episodes": way,
        "seed": seed,
        "area_under_curve": LearningCurve(episodes, budget).figures()["area_under_curve"],
        "guided": ledger.guided / ledger.frames,
        "guided_and_missed": ledger.missed / max(1, ledger.guided),
        "guided_and_unsolved": ledger.unsolved / max(1, ledger.guided),
        "own_decisions": {str(subgoal): ledger.tried[str(subgoal)] for subgoal in task.subgoals},
        "frames_to": {str(subgoal): ledger.passed.get(str(subgoal), {}) for subgoal in task.subgoals},
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=["A", "B", "C", "D", "C-place", "D-place"])
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--frames", type=int, help="of every run, instead of its usual budget")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--registry", default="build/bench", help="where the sources are")
    parser.add_argument("--output", type=Path, default=HERE / "why.json", help="the result file")
    options = parser.parse_args()
    jobs = [(name, way, seed) for seed in options.seeds for name in options.scenarios for way in options.ways]
    code, known = commit(), {}
    if options.output.exists():
        known = {_key(run): run for run in json.loads(options.output.read_text())["runs"]}
    with get_context("spawn").Pool(options.workers, maxtasksperchild=1) as pool:
        for run in pool.imap_unordered(partial(learned, options.registry, options.frames), jobs):
            known[_key(run)] = {**run, "commit": code, "machine": machine()}
            runs = [known[key] for key in sorted(known)]
            written = datetime.now(UTC).isoformat(timespec="seconds")
            options.output.write_text(json.dumps({"runs": runs, "written": written}, indent=1) + "\n")
    print(why_table(list(known.values())))


def _key(run: Result) -> tuple[str, str, int]:
    return run["scenario"], run["episodes"], run["seed"]


if __name__ == "__main__":
    main()
