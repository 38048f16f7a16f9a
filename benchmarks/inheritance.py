"""What inheritance gives by itself: the target learns alone, from its most similar source's low level.

`paddle` hands a low level on to its target, too; what it has beyond this is what its guides give. The sources
are those that learning.py has trained in the same registry, of the seed of each run:

    python benchmarks/learning.py --parts sources
    python benchmarks/inheritance.py --scenarios A C
"""

import argparse
import json
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from learning import BARS, BUDGETS, HERE, SEEDS, Ended, _reached, commit, machine, scenario_of, sources_of
from readme_table import inheritance_table

from paddlectl.registry.store import Registry

Result = dict[str, Any]


def learned(registry: str, frames: int | None, job: tuple[str, int]) -> Result:
    """One run, as `paddle` sets it up but for its guides."""
    import numpy as np
    import torch

    from paddlectl.agents.evaluation import evaluate
    from paddlectl.agents.interaction import Learning
    from paddlectl.experiments.curves import curve_figures, in_order
    from paddlectl.experiments.log import versions
    from paddlectl.experiments.policies import EVALUATION_EPISODES, EVALUATION_SEED
    from paddlectl.experiments.runner import _source
    from paddlectl.hybrid.agent import HybridAgent
    from paddlectl.hybrid.policy import HybridPolicy, ProgramSelector
    from paddlectl.hybrid.settings import settings_for
    from paddlectl.methods.paddle import _guide, _mapping, _warm_start
    from paddlectl.tasks.suite import load
    from paddlectl.transfer.guidance import GuidanceSettings

    torch.set_num_threads(1)
    scenario, seed = scenario_of(job[0]), job[1]
    task, opened = load(scenario.target), Registry.open(registry)
    target = HybridPolicy(task, seed, settings_for(task))
    sources = [_guide(_source(opened, policy)) for policy in sources_of(opened, scenario, seed)]
    mapping, _ = _mapping(target, sources, scenario.similarity)
    _warm_start(target, sources, mapping, GuidanceSettings().inheritance)
    layouts, choices = np.random.SeedSequence(seed).spawn(2)
    selector = ProgramSelector(target, np.random.default_rng(choices))
    actions = np.random.default_rng(layouts.spawn(1)[0])
    agent = HybridAgent(target, selector, [target.low_level], actions)
    environment = task.make(target.settings.num_envs, int(layouts.generate_state(1)[0]))
    learning = Learning(environment, agent, frames or BUDGETS[task.name])
    episodes, progress = [], []
    for round_ in learning:
        episodes += [Ended(e.order, e.started, e.finished, e.score) for e in round_.episodes]
        progress.append({"frames": round_.frames, "seconds": None})
    found = evaluate(target, task, EVALUATION_EPISODES, EVALUATION_SEED)
    known = in_order(episodes)
    return {
        "name": f"{task.name}, inheritance without guides, scenario {scenario.name}",
        "seed": seed,
        "frames": learning.frames,
        **curve_figures(episodes, learning.frames),
        "to_success": {str(bar): _reached(known, progress, bar) for bar in BARS},
        "success": found.success_rate,
        "mean_length": found.mean_length,
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=["A", "C"], help="names of files in scenarios/")
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--frames", type=int, help="of every run, instead of its usual budget")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--registry", default="build/bench", help="where the sources are")
    parser.add_argument("--output", type=Path, default=HERE / "inheritance.json", help="the result file")
    options = parser.parse_args()
    jobs = [(scenario, seed) for scenario in options.scenarios for seed in options.seeds]
    with get_context("spawn").Pool(options.workers) as pool:
        runs = pool.map(partial(learned, options.registry, options.frames), jobs, chunksize=1)
    results = {"runs": runs, "written": datetime.now(UTC).isoformat(timespec="seconds")}
    options.output.write_text(json.dumps(results, indent=1) + "\n")
    print(inheritance_table(runs))


if __name__ == "__main__":
    main()
