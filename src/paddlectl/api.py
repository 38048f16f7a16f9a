"""What `import paddlectl` offers: the commands' work as functions of Python.

Registries are found as by the commands: `registry=`, else PADDLECTL_REGISTRY, else `registry/`. A run goes on
in the process that asks for it, and tells how far it is on stderr: on a terminal as a bar, else, as in a
notebook, by a line now and then. ^C ends it, and `paddlectl resume` goes on with it.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from paddlectl import shipped
from paddlectl.cli.named import labels_of, policy_named
from paddlectl.cli.options import REGISTRY, at_home, place
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.fields import MOST_FRAMES, SEEDS
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.naming import SUFFIXES

if TYPE_CHECKING:
    from paddlectl.agents import base
    from paddlectl.agents.playing import Playing
    from paddlectl.experiments.jobs import TrainJob
    from paddlectl.tasks.environment import TaskEnv

    Place = str | os.PathLike[str] | None

_SUFFIX = ".zip"
_FIGURES = (
    "success_rate",
    "mean_score",
    "mean_length",
    "crispness",
    "jump_start",
    "final_score",
    "final_success",
    "area_under_curve",
)


class Policy:
    """A learned policy; `load`, `train` and `transfer` give one.

    Attributes:
        id: `policy-7`.
        task: The task that it was learned on.
        method: By which.
        program: Its clauses as text, a line each with its probability; None of a method without clauses.
        figures: `success_rate`, `mean_score`, `mean_length` and `crispness` on unseen layouts.
    """

    def __init__(self, record: PolicyRecord, revived: "base.Policy", seed: int) -> None:
        self.id, self.task, self.method = record.id, record.task, record.method
        self.program = record.program
        self.figures = {name: getattr(record, name) for name in _FIGURES[:4]}
        self._record, self._revived, self._seed = record, revived, seed
        self._playing: WeakKeyDictionary[TaskEnv, Playing] = WeakKeyDictionary()

    def __repr__(self) -> str:
        solved = f"solves {100 * self._record.success_rate:.0f} %"
        return f"<{self.id}: {self.task} by {self.method}, {solved}>"

    def act(self, env: Any) -> Any:
        """The action for the environment's present state, as `env.step` takes it.

        It reads the state off the environment itself, whatever wrappers there are, and knows when an episode
        begins. Several environments may take turns. It explores nothing; what it leaves to chance follows
        from the seed that it was loaded with.

        Args:
            env: `gymnasium.make("paddlectl.tasks.registration:paddle/BoxDoor-v0")`, or of another task of
                the policy's domain; after `reset`.

        Raises:
            UsageError: If it is no environment of paddlectl's tasks, or wasn't reset yet.
            IntegrityError: If it is one of another domain.
        """
        from paddlectl.tasks.environment import TaskEnv
        from paddlectl.tasks.registration import ENTRY_POINTS, environment_id

        inner = env.unwrapped
        if not isinstance(inner, TaskEnv):
            made = f'gymnasium.make("paddlectl.tasks.registration:{environment_id(self.task)}")'
            way = f"try {made}" if self.task in ENTRY_POINTS else f"{self.task} has none; evaluate plays it"
            raise UsageError(f"{type(inner).__name__} is no environment of a task of paddlectl", way)
        if not inner.episode:
            raise UsageError("the environment has no episode yet", "call its reset() first")
        playing = self._playing.get(inner)
        if playing is None:
            playing = self._playing[inner] = self._begin(inner)
        return playing.act(inner)

    def _begin(self, env: "TaskEnv") -> "Playing":
        from paddlectl.agents.playing import Playing
        from paddlectl.experiments.policies import require_domain
        from paddlectl.tasks import suite

        task = suite.load(env.asked)
        require_domain(self._record, task)
        return Playing(self._revived, task, env, self._seed)


@dataclass(frozen=True)
class Result:
    """A run that has finished.

    Attributes:
        run: Its id, for `explain` and the like.
        policy: What it learned.
        figures: As `train --json` and `transfer --json` have them: `success_rate` on unseen
            layouts, and of a transfer `jump_start`, `final_score`, `final_success` and `area_under_curve`.
        frames: Environment steps.
        episodes: That ended.
        seconds: That it took.
    """

    run: str
    policy: Policy
    figures: dict[str, float | None]
    frames: int
    episodes: int
    seconds: float


class Runs(list[dict[str, Any]]):
    """Rows of runs, newest first: `pandas.DataFrame(runs)` and `polars.DataFrame(runs.rows)` take them.

    All rows have the same fields, with one value each.
    """

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A plain list of the rows."""
        return list(self)

    def to_dict(self) -> dict[str, list[Any]]:
        """Field -> its values in all rows."""
        return {name: [row[name] for row in self] for name in (self[0] if self else ())}


def add_tasks(file: "str | os.PathLike[str]") -> tuple[str, ...]:
    """Runs a Python file and takes in its `TASKS` for this process, as `--tasks` does; gives their names.

    Args:
        file: Its path.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it fails, or has no tasks.
    """
    from paddlectl.tasks.suite import add_file

    return add_file(Path(at_home(os.fspath(file))).resolve())


def load(name: "str | os.PathLike[str]", registry: "Place" = None, seed: int = 0) -> Policy:
    """A policy from a registry, or from a file that `paddlectl registry export` wrote.

    Args:
        name: A policy's id, a task's name or file (`.yaml`) for its best policy, or the path of what was
            exported, which ends in `.zip`.
        registry: Where it is kept.
        seed: Of what the policy leaves to chance.

    Raises:
        NotFoundError: If there is no such policy, registry or file.
        IntegrityError: If it can't be used here; `IntegrityError.hint` says what to do.
    """
    _require_seed(seed)
    path = Path(at_home(os.fspath(name)))
    if path.suffix == _SUFFIX or (isinstance(name, os.PathLike) and path.suffix not in SUFFIXES):
        return _from_file(path, seed)
    with Registry.open(_place(registry), create=False) as opened:
        return _revived(opened, policy_named(opened, os.fspath(name)), seed)


def _from_file(path: Path, seed: int) -> Policy:
    from paddlectl.registry.bundles import bundles

    with TemporaryDirectory() as folder:
        place = Path(folder) / "registry"
        told = bundles.import_(lambda: Registry.open(place), path)
        if told["policy"] is None:
            raise NotFoundError(f"{path} holds a run that left no policy", "export a policy instead")
        with Registry.open(place) as opened:
            return _revived(opened, opened.policy(told["policy"]), seed)


def _revived(registry: Registry, record: PolicyRecord, seed: int) -> Policy:
    from paddlectl.experiments.policies import revive

    return Policy(record, revive(registry, record), seed)


def train(
    task: "str | os.PathLike[str]",
    seed: int = 0,
    frames: int | None = None,
    method: str = "hdm",
    registry: "Place" = None,
    name: str | None = None,
    tags: Sequence[str] = (),
) -> Result:
    """Learns a task from scratch and keeps what was learned, as `paddlectl train`.

    Args:
        task: Its name, of which `paddlectl tasks` has a list, or a task file.
        seed: Of all chance: equal seeds give equal policies.
        frames: At most so many environment steps; None is the method's own budget.
        method: By which.
        registry: Where it is kept; made where there is none.
        name: What to call the run, instead of its id.
        tags: Words to find it by.

    Raises:
        NotFoundError: If there is no such task or file.
        InvalidFileError: If the file is no task, or one that can't be solved.
        UsageError: If there is no such method, or it trains no sources.
    """
    from paddlectl.cli.train import train_jobs

    _require_seed(seed)
    _require_frames(frames)
    (job,) = train_jobs([os.fspath(task)], [seed], frames, None, method)
    location = _place(registry)
    labels = labels_of(name, tags, [str(job.task)], location)
    return _trained(replace(job, **labels._asdict()), location)


def transfer(
    scenario: "str | os.PathLike[str] | Mapping[str, Any]",
    method: str | None = None,
    seed: int | None = None,
    frames: int | None = None,
    registry: "Place" = None,
    train_missing: bool = False,
    name: str | None = None,
    tags: Sequence[str] = (),
) -> Result:
    """Learns a scenario's target with policies of its sources, as `paddlectl transfer`.

    Args:
        scenario: A file, the name of one that is shipped (`A`), or a mapping with what one holds:
            `{"name": "A", "target": …, "sources": […]}`.
        method: Instead of the scenario's.
        seed: Instead of the scenario's first.
        frames: Environment steps, instead of the scenario's.
        registry: Where the sources are, and what is learned is kept.
        train_missing: Whether to train the sources that the registry lacks.
        name: What to call the run, instead of its id.
        tags: Words to find it by.

    Raises:
        NotFoundError: If the file or a source isn't there.
        InvalidFileError: If it is no scenario.
        UsageError: If there is no such method, or a source can't be reused.
    """
    from paddlectl.cli.transfer import asked_for, missing_of, sources_of
    from paddlectl.methods.changes import Changes
    from paddlectl.scenario import load_scenario, scenario_of

    if isinstance(scenario, Mapping):
        asked = scenario_of(scenario)
    else:
        asked = load_scenario(shipped.scenario(at_home(os.fspath(scenario))))
    by, seed = method or asked.method, asked.seeds[0] if seed is None else seed
    _require_seed(seed)
    _require_frames(frames)
    location = _place(registry)
    labels = labels_of(name, tags, [str(asked.target)], location)
    if train_missing:
        for missing in missing_of(asked, by, (seed,), location):
            _trained(missing, location)
    sources = sources_of(asked, by, (seed,), location, train_missing=False)
    (each,) = asked_for(asked, sources.ids, by, frames or asked.frames, Changes({}, {}), labels)
    from paddlectl.experiments.runner import run_transfer

    return _run(each.job, location, each.name, run_transfer)


def _trained(job: "TrainJob", location: str) -> Result:
    from paddlectl.experiments.runner import train_source

    return _run(job, location, f"{job.task} seed {job.seed}", train_source)


def _run(job: Any, location: str, name: str, work: Callable[..., dict[str, Any]]) -> Result:
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.experiments.checkpointer import Checkpointer
    from paddlectl.experiments.policies import one_thread
    from paddlectl.report.progress import progress

    with Registry.open(location) as opened, stdout_kept(), one_thread(), progress([name]) as view:
        begun: list[str] = []
        keeper = Checkpointer(tell=lambda text: view.note(f"note: {text}"), begun=begun.append)
        try:
            row = work(job, opened, lambda tick: view.tick(0, tick), keeper)
        except KeyboardInterrupt:
            view.note(" ".join(["go on with: paddlectl resume", *begun]))
            raise
        policy = _revived(opened, opened.policy(row["policy"]), seed=0)
    figures = {field: row[field] for field in _FIGURES if field in row}
    return Result(row["run"], policy, figures, row["frames"], row["episodes"], row["seconds"])


def runs(registry: "Place" = None, limit: int | None = None) -> Runs:
    """The runs in a registry, newest first, as `paddlectl runs`.

    Args:
        registry: Which.
        limit: At most so many; None is all.

    Raises:
        NotFoundError: If there is no registry.
    """
    from paddlectl.report.documents import run_row

    if limit is not None and limit < 1:
        raise UsageError(f"the limit is a whole number from 1 on, not {limit!r}")
    with Registry.open(_place(registry), create=False) as opened:
        rows = [run_row(run) for run in opened.newest_runs(limit)[0]]
    return Runs(_flat(row) for row in rows)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """With the results that all methods know as fields of their own."""
    results = row.pop("results")
    row |= {field: " ".join(row[field]) for field in ("sources", "tags")}
    return row | {name: results.get(name) for name in _FIGURES}


def _place(registry: "Place") -> str:
    """Where the registry is."""
    return place(os.fspath(registry or os.environ.get(REGISTRY) or "registry"))


def _require_seed(seed: int) -> None:
    if type(seed) is not int or not 0 <= seed < SEEDS:
        raise UsageError(f"a seed is a whole number in 0..{SEEDS - 1}, not {seed!r}")


def _require_frames(frames: int | None) -> None:
    if frames is not None and (type(frames) is not int or not 1 <= frames <= MOST_FRAMES):
        raise UsageError(f"frames are a whole number in 1..{MOST_FRAMES}, not {frames!r}")
