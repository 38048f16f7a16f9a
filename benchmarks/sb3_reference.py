"""Stable-Baselines3's PPO on flat BoxDoor, beside our own training; merges each part into a JSON result.

All contenders have the same networks, optimiser and epochs. `speed` takes turns, in one process, between our
training, SB3 as its users run it (eight Gymnasium environments, the flattened image, minibatches of 256), and
SB3 on our batched engine with our minibatches. `solve` trains SB3 on the engine, on the very state that the
method `ppo` sees, until 97 of 100 episodes that started one after another were solved; beside it stand the
hybrid model's figures of benchmarks/learning.json. Needs `pip install -e '.[bench]'`:

    OMP_NUM_THREADS=1 python benchmarks/sb3_reference.py --parts speed
    OMP_NUM_THREADS=1 python benchmarks/sb3_reference.py --parts solve --seeds 10 11 12 --cap 3600

SB3's learning rate is constant, as it has no budget to fall over; ours falls.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium
import numpy as np
import torch
from learning import Ended, _reached, commit, machine
from minigrid.wrappers import ImgObsWrapper
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv
from training_speed import measure

from paddlectl.experiments.curves import in_order
from paddlectl.experiments.curves import rates as curve_rates
from paddlectl.experiments.log import versions
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.tasks import suite
from paddlectl.tasks.base import Bools, Floats, Ints

HERE = Path(__file__).parent
TASK = "BoxDoor"
GYMNASIUM_ID = f"paddlectl.tasks.minigrid.env:paddle/{TASK}-v0"
ENVIRONMENTS, LONG_STEPS, MINIBATCH = 8, 512, 256  # of SB3 on Gymnasium, as its users have it
SETTINGS = HybridSettings()
LANES, STEPS = SETTINGS.num_envs, SETTINGS.rollout_steps  # of SB3 on the engine, as we have it
FRAMES = LANES * STEPS
PARTS = ("speed", "solve")
BAR = 0.97
UNITS = ("frames", "seconds")
Result = dict[str, Any]


class Lanes(VecEnv):
    """The lanes of our engine as SB3 wants them: the flat task, its extrinsic reward, resets by itself."""

    def __init__(self, num_envs: int, seed: int, task: str = TASK) -> None:
        self._engine: Any = suite.load(task).make(num_envs, seed)
        self._order = np.arange(num_envs)
        self.frames = 0
        self.episodes: list[Ended] = []
        self._started = np.zeros(num_envs, np.intp)
        super().__init__(
            num_envs,
            gymnasium.spaces.Box(-1, 1, (self._engine.flat_size,), np.float32),
            gymnasium.spaces.Discrete(self._engine.actions.size),
        )

    def reset(self) -> Floats:
        self._engine.reset()
        return self._engine.flat_state()

    def step_async(self, actions: Ints) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Floats, Floats, Bools, list[Result]]:
        step = self._engine.step(self._actions)
        self.frames += self.num_envs
        done = step.terminated | step.truncated
        observation = self._engine.flat_state()
        infos: list[Result] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        if len(ended):
            for lane in ended:
                infos[lane] = {
                    "terminal_observation": observation[lane],
                    "TimeLimit.truncated": bool(step.truncated[lane]),
                }
            self._record(ended, step.score > 0)
            self._engine.reset(done)
            observation = self._engine.flat_state()
        return observation, step.reward, done, infos

    def _record(self, ended: Ints, solved: Bools) -> None:
        """Episodes are numbered by their start, as `hybrid.rollout` does it."""
        self.episodes += [
            Ended(int(self._order[lane]), int(self._started[lane]), self.frames, float(solved[lane]))
            for lane in ended
        ]
        self._started[ended] = self.frames
        self._order[ended] = self._order.max() + 1 + np.arange(len(ended))

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        if attr_name != "render_mode":
            raise AttributeError(attr_name)
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


class Rounds(BaseCallback):
    """When each round ended, its update included; stops the training after one that is `enough`.

    Its clock starts when it is made, and stands still while `enough` is asked.
    """

    def __init__(self, enough: Callable[[Sequence[Result]], bool] = lambda rows: False) -> None:
        super().__init__()
        self.rows: list[Result] = []
        self._enough = enough
        self._stop = False
        self._began = time.perf_counter()

    def _on_rollout_start(self) -> None:
        now = time.perf_counter()
        self._append(now)
        self._stop = self._enough(self.rows)
        self._began += time.perf_counter() - now

    def _on_step(self) -> bool:
        return not self._stop

    def _on_training_end(self) -> None:
        self._append(time.perf_counter())

    def _append(self, now: float) -> None:
        self.rows.append({"frames": self.num_timesteps, "seconds": round(now - self._began, 3)})


def ppo(environment: VecEnv, steps: int, minibatch: int, seed: int) -> PPO:
    """SB3's PPO with the numbers and networks of ours."""
    ours = SETTINGS.low_level
    return PPO(
        "MlpPolicy",
        environment,
        learning_rate=ours.learning_rate,
        n_steps=steps,
        batch_size=minibatch,
        n_epochs=ours.epochs,
        gamma=ours.discount,
        gae_lambda=ours.trace_decay,
        clip_range=ours.clip,
        ent_coef=ours.entropy_coef,
        vf_coef=ours.value_coef,
        max_grad_norm=ours.max_gradient_norm,
        policy_kwargs={
            "net_arch": {"pi": [400] * 3, "vf": [400] * 3},
            "activation_fn": torch.nn.ReLU,
            "optimizer_class": torch.optim.RMSprop,
            "optimizer_kwargs": {"alpha": 0.99, "eps": 1e-5},
        },
        seed=seed,
        device="cpu",
    )


def on_gymnasium() -> PPO:
    environments = make_vec_env(GYMNASIUM_ID, ENVIRONMENTS, seed=0, wrapper_class=flat_image)
    return ppo(environments, LONG_STEPS, MINIBATCH, 0)


def flat_image(environment: gymnasium.Env) -> gymnasium.Env:
    return gymnasium.wrappers.FlattenObservation(ImgObsWrapper(environment))


def on_engine(seed: int, task: str = TASK) -> PPO:
    return ppo(Lanes(LANES, seed, task), STEPS, SETTINGS.low_level.minibatch, seed)


def rate(model: PPO, rounds: int) -> int:
    """Frames a second over that many rounds; the first, in which all is warmed up, isn't counted."""
    callback = Rounds()
    model.learn((rounds + 1) * FRAMES, callback)
    first, last = callback.rows[1], callback.rows[-1]
    return round((last["frames"] - first["frames"]) / (last["seconds"] - first["seconds"]))


def speed(rounds: int, repeats: int) -> Result:
    """Frames a second of the three in turns, and how many times as fast as SB3 we are.

    Also by the processor's seconds, which other processes on a busy machine take nothing of.
    """
    frames = rounds * FRAMES
    our_rounds = max(1, frames // (SETTINGS.num_envs * SETTINGS.rollout_steps))
    contenders: dict[str, Callable[[], int]] = {
        "ours": lambda: measure(TASK, our_rounds)["frames_per_second"],
        "sb3_gymnasium": lambda: rate(on_gymnasium(), rounds),
        "sb3_engine": lambda: rate(on_engine(0), rounds),
    }
    rates: dict[str, list[int]] = {name: [] for name in contenders}
    shares: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, contender in contenders.items():
            began, cpu_began = time.perf_counter(), time.process_time()
            rates[name].append(contender())
            shares[name].append((time.process_time() - cpu_began) / (time.perf_counter() - began))
            print(f"{name}: {rates[name][-1]:,} frames/s, {shares[name][-1]:.0%} of a core", file=sys.stderr)
    by_cpu = {name: np.divide(rates[name], shares[name]).tolist() for name in contenders}
    return {
        "task": TASK,
        "seed": 0,
        "frames_each": frames,
        "lanes": {"ours": SETTINGS.num_envs, "sb3_gymnasium": ENVIRONMENTS, "sb3_engine": LANES},
        "steps": {"ours": SETTINGS.rollout_steps, "sb3_gymnasium": LONG_STEPS, "sb3_engine": STEPS},
        "minibatch": {
            "ours": SETTINGS.low_level.minibatch,
            "sb3_gymnasium": MINIBATCH,
            "sb3_engine": SETTINGS.low_level.minibatch,
        },
        "frames_per_second": _medians(rates),
        "ratio": _ratios(rates),
        "frames_per_cpu_second": _medians(by_cpu),
        "ratio_by_cpu": _ratios(by_cpu),
        "all_frames_per_second": rates,
        "all_cpu_shares": {name: [round(share, 3) for share in values] for name, values in shares.items()},
        **made_with(),
    }


def _medians(rates: dict[str, list[Any]]) -> dict[str, int]:
    return {name: round(median(values)) for name, values in rates.items()}


def _ratios(rates: dict[str, list[Any]]) -> dict[str, float]:
    """Ours to each other's, the median over the turns."""
    ours, *others = rates
    return {name: round(float(np.median(np.divide(rates[ours], rates[name]))), 2) for name in others}


def solve(seed: int, cap: float) -> Result:
    """Trains SB3 on the engine until it reached the bar, or for `cap` seconds."""
    told = -1

    def reached(rows: Sequence[Result]) -> Result | None:
        return _reached(in_order(model.env.episodes), rows, BAR)

    def enough(rows: Sequence[Result]) -> bool:
        nonlocal told
        seconds = rows[-1]["seconds"]
        if told < (told := int(10 * seconds / cap)):
            where = f"{rows[-1]['frames']:,} frames, {seconds:.0f} s, {recent_success(model.env.episodes)}"
            print(f"seed {seed}: {where}", file=sys.stderr)
        return seconds >= cap or reached(rows) is not None

    began = time.process_time()
    callback = Rounds(enough)
    model = on_engine(seed)
    model.learn(sys.maxsize, callback)
    end = callback.rows[-2]  # the last whole round; learning was stopped in the next one's first step
    return {
        "task": TASK,
        "seed": seed,
        "cap": cap,
        "lanes": LANES,
        "steps": STEPS,
        "minibatch": SETTINGS.low_level.minibatch,
        "frames": end["frames"],
        "seconds": end["seconds"],
        "cpu_seconds": round(time.process_time() - began, 3),  # less than `seconds` if the machine was busy
        "episodes": len(model.env.episodes),
        "final_success": recent_success(model.env.episodes),
        "to_success": {str(BAR): reached(callback.rows[:-1])},
        **made_with(),
    }


def recent_success(episodes: Sequence[Ended]) -> float | None:
    """Of the last 100 in the order of their start; None as long as the first goes on."""
    return curve_rates(in_order(episodes))["latest_success"]


def beside_ours(run: Result) -> Result:
    """The run with our own frames and seconds to the bar, and the ratios; lower bounds if it didn't reach it.

    Seconds compare only where our run, too, was done on this processor.
    """
    path = HERE / "learning.json"
    runs = json.loads(path.read_text())["runs"] if path.exists() else {}
    our_run = runs.get(f"source {TASK} seed {run['seed']}")
    ours = our_run and our_run["to_success"][str(BAR)]
    theirs = run["to_success"][str(BAR)]
    return {
        **run,
        "ours": ours and {**ours, "commit": our_run["commit"], "machine": our_run["machine"]},
        "ratio": {unit: round((theirs or run)[unit] / ours[unit], 1) for unit in UNITS} if ours else None,
        "ratio_is_lower_bound": theirs is None,
        "same_cpu": bool(our_run) and our_run["machine"]["cpu"] == run["machine"]["cpu"],
    }


def made_with() -> Result:
    return {
        "threads": torch.get_num_threads(),
        "commit": commit(),
        "versions": {**versions(), "stable-baselines3": version("stable-baselines3")},
        "machine": machine(),
    }


def merge(path: Path, change: Callable[[Result], Any]) -> Result:
    """Changes the result file, whatever else it holds, and sets our latest figures beside SB3's."""
    results: Result = json.loads(path.read_text()) if path.exists() else {"speed": None, "solve": {}}
    change(results)
    results["solve"] = {name: beside_ours(run) for name, run in sorted(results["solve"].items())}
    results["written"] = datetime.now(UTC).isoformat(timespec="seconds")
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(results, indent=1) + "\n")
    partial.replace(path)
    return results


def table(results: Result) -> str:
    return "\n".join([*_speed_lines(results["speed"]), *_solve_lines(results["solve"].values())])


def _speed_lines(found: Result | None) -> Iterator[str]:
    if not found:
        return
    titles = ("lanes x steps", "minibatch", "frames/s", "ours is", "frames/CPU s", "ours is")
    yield f"{'':16}" + "".join(f"{title:>14}" for title in titles)
    for name, minibatch in found["minibatch"].items():
        cells = [f"{found['lanes'][name]} x {found['steps'][name]}", str(minibatch)]
        for rates, ratio in (("frames_per_second", "ratio"), ("frames_per_cpu_second", "ratio_by_cpu")):
            times = f"{found[ratio][name]:.2f} x" if name in found[ratio] else ""
            cells += [f"{found[rates][name]:,}", times]
        yield f"{name:16}" + "".join(f"{cell:>14}" for cell in cells)


def _solve_lines(runs: Iterable[Result]) -> Iterator[str]:
    """SB3's frames and seconds to the bar, ours, and the ratios; `*` where another processor ran ours."""
    yield f"{f'to {BAR:.0%}':16}{'SB3':>24}{'ours':>24}{'ratio':>24}"
    yield f"{'':16}" + "".join(f"{unit:>12}" for unit in UNITS) * 3
    for run in runs:
        sign = ">=" if run["ratio_is_lower_bound"] else ""
        theirs = [f"{sign}{(run['to_success'][str(BAR)] or run)[unit]:,.0f}" for unit in UNITS]
        ours = [f"{run['ours'][unit]:,.0f}" if run["ours"] else "-" for unit in UNITS]
        ratios = [f"{sign}{run['ratio'][unit]}" if run["ratio"] else "-" for unit in UNITS]
        mark = "" if run["same_cpu"] else " *"
        yield f"{'seed ' + str(run['seed']):16}" + "".join(f"{c:>12}" for c in theirs + ours + ratios) + mark


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--parts", nargs="*", choices=PARTS, default=PARTS, help="none: only set our latest figures beside"
    )
    parser.add_argument("--seeds", nargs="+", type=int, default=[10, 11, 12], help="of `solve`")
    parser.add_argument("--cap", type=float, default=3600, help="seconds of `solve` for each seed")
    parser.add_argument("--rounds", type=int, default=8, help="counted rounds of each turn of `speed`")
    parser.add_argument("--repeats", type=int, default=3, help="turns of `speed`")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_suffix(".json"))
    return parser.parse_args()


def main() -> None:
    options = parsed()
    torch.set_num_threads(1)
    results = merge(options.output, lambda results: None)
    if "speed" in options.parts:
        found = speed(options.rounds, options.repeats)
        results = merge(options.output, lambda results: results.update(speed=found))
    for seed in options.seeds if "solve" in options.parts else ():
        run = {f"seed {seed}": solve(seed, options.cap)}
        results = merge(options.output, lambda results, run=run: results["solve"].update(run))
    print(table(results))


if __name__ == "__main__":
    main()
