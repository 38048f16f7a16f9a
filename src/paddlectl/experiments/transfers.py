"""Running a scenario: PADDLE from its sources, or the hybrid model from scratch."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from paddlectl.errors import IntegrityError, InvalidFileError
from paddlectl.experiments.curves import WINDOW, curve_figures
from paddlectl.experiments.jobs import Progress, TransferJob
from paddlectl.experiments.log import recorded, versions
from paddlectl.experiments.pace import Pace
from paddlectl.experiments.sources import keep, preset, revive
from paddlectl.hybrid import training
from paddlectl.hybrid.policy import HybridPolicy, HybridSettings, settings_for
from paddlectl.hybrid.rollout import Episode
from paddlectl.hybrid.training import Learning, Round
from paddlectl.learners.base import Learner
from paddlectl.logic.clauses import Scene, scenes_of
from paddlectl.logic.syntax import parse_program
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Similarity
from paddlectl.tasks.base import GUIDED, Task
from paddlectl.tasks.suite import load
from paddlectl.transfer import guides, paddle
from paddlectl.transfer.account import Account
from paddlectl.transfer.candidates import Source, candidates_of, most_similar
from paddlectl.transfer.documents import mapping_document
from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.transfer.similarity import SceneMapping, map_scenes


def run_transfer(
    job: TransferJob, registry: Registry, report: Callable[[Progress], None], pace: Pace | None = None
) -> dict[str, Any]:
    """Learns a scenario's target, by `paddle` from its sources or by `hdm` from scratch.

    Args:
        job: What to learn.
        registry: Where it is kept.
        report: Told of each round.
        pace: When checkpoints are kept, and the run to go on with, if any.

    Returns:
        A row of `transfer --json`.
    """
    task = load(job.scenario.target)
    settings = settings_for(task, preset(task, _way(job, task)), _paper_way(job, task), job.hybrid)
    pace = pace or Pace()
    run = pace.begin(registry, lambda: _new_run(job, task, settings, registry))
    with recorded(registry, run) as log:
        target = HybridPolicy(task, job.seed, settings)
        account: _RunAccount | None = None
        if job.method == "hdm":
            learning = training.train(target, job.seed, job.frames)
        else:
            learning, account = _guided(job, registry, run, target)
        pace.tell_of_rounds(job.frames, learning.round)
        with pace.rounds(registry, log, {"learning": learning, "account": account}) as after_round:
            for round_ in learning:
                log.add(round_)
                if account is not None:
                    account.take(round_, log.curve.known)
                log.write(round_)
                report(log.progress(max(job.frames, learning.round)))
                after_round()
        if account is not None:
            account.close()
        kept = keep(registry, run, target, log)
        figures = curve_figures(log.ended(), log.frames)
        log.results = figures | {"mean_length": kept.mean_length, "crispness": kept.crispness}
    return {
        "run": run.id,
        "policy": kept.id,
        "method": job.method,
        "seed": job.seed,
        **log.counts(),
        **figures,
    }


def _new_run(job: TransferJob, task: Task, settings: HybridSettings, registry: Registry) -> RunRecord:
    return registry.add_run(
        kind="transfer",
        method=job.method,
        task=task.name,
        scenario=job.scenario.name,
        sources=() if job.method == "hdm" else job.sources,
        seed=job.seed,
        settings={
            "frames": job.frames,
            "preset": _way(job, task),
            "scenario": job.scenario.model_dump(mode="json"),
            "hybrid": dataclasses.asdict(settings),
            "guidance": dataclasses.asdict(_rules(job, task)),
        },
        versions=versions(),
    )


def _way(job: TransferJob, task: Task) -> str | None:
    """The preset by which the target is learned: `guided` is for who inherits."""
    inherits = job.method == "paddle" and job.scenario.guidance.mode == "default"
    return GUIDED if inherits and GUIDED in task.presets else None


def _paper_way(job: TransferJob, task: Task) -> Mapping[str, Any]:
    """What `guidance: paper` asks of the hybrid model: its environments, and guides as patient as itself."""
    readings = job.scenario.guidance.readings()
    if job.method != "paddle" or readings is None:
        return {}
    usual = settings_for(task)
    block = max(1, usual.lanes * usual.block // readings.lanes)
    return {
        "lanes": readings.lanes,
        "block": block,
        "decisions": {"patience": 1.0},
        "credit": {"imitation_margin": readings.imitation_margin},
    }


def _rules(job: TransferJob, task: Task) -> GuidanceSettings:
    return job.rules or dataclasses.replace(GuidanceSettings(), **task.guidance)


def _guided(
    job: TransferJob, registry: Registry, run: RunRecord, target: HybridPolicy
) -> "tuple[Learning, _RunAccount]":
    """Algorithm 2, leaving Ψ and its account in the run's folder."""
    sources = [_source(registry, policy) for policy in job.sources]
    mapping, document = _mapping(target, sources, job.scenario.similarity)
    registry.write_document(run.id, "mapping", document)
    lanes, sharpness = target.settings.lanes, target.settings.sharpness
    readings = job.scenario.guidance.readings()
    softness = readings.source_softness if readings else 0.0
    candidates = candidates_of(target.task, target.clauses.bodies, sources, mapping, sharpness, softness)
    rng = np.random.default_rng(job.seed)
    if readings:
        chooser: guides.GuideChooser = guides.PaperGuides(target, candidates, lanes, rng, readings)
    else:
        rules = _rules(job, target.task)
        chooser = guides.PlannedGuides(target, candidates, lanes, rng, rules)
        _inherit(target, sources, mapping, rules.inheritance)
    learning = paddle.learn(target, sources, chooser, job.seed, job.frames)
    return learning, _RunAccount(registry, run.id, chooser, Account(chooser, sources), job.frames)


def _inherit(target: HybridPolicy, sources: Sequence[Source], mapping: SceneMapping, share: float) -> None:
    """The most similar of the sources whose networks have the target's shape hands them on."""
    like = [source for source in sources if _shapes(source.low_level) == _shapes(target.low_level)]
    if share and like:
        target.low_level.inherit(most_similar(like, mapping).low_level.state(), share)


def _shapes(learner: Learner) -> dict[str, tuple[int, ...]]:
    return {name: tuple(tensor.shape) for name, tensor in learner.state().items()}


def _source(registry: Registry, policy: str) -> Source:
    record = registry.policy(policy)
    revived = revive(registry, record)
    try:
        program = parse_program(record.program)
    except InvalidFileError as error:
        raise IntegrityError(
            f"the program of {record.id} is damaged: {error.message}",
            f"train it again: paddlectl train {record.task}",
        ) from error
    return Source(record.id, record.task, revived.task.heads, program, revived.low_level)


def _mapping(
    target: HybridPolicy, sources: Sequence[Source], weights: Similarity
) -> tuple[SceneMapping, dict[str, Any]]:
    scenes = [Scene(body, frozenset(target.task.heads)) for body in target.clauses.bodies]
    programs = {source.policy: scenes_of(source.program.clauses) for source in sources}
    mapping = map_scenes(scenes, programs, weights.body_weight, weights.head_weight)
    tasks = {source.policy: source.task for source in sources}
    name = target.task.name
    return mapping, mapping_document(name, scenes, mapping, tasks, weights.body_weight, weights.head_weight)


class _RunAccount:
    """Keeps the weights and an episode of the first hundred, and of the last tenth of the run."""

    def __init__(
        self, registry: Registry, run: str, chooser: guides.GuideChooser, account: Account, frames: int
    ) -> None:
        self._registry = registry
        self._run = run
        self._chooser = chooser
        self._account = account
        self._frames = frames
        self._phase, self._since = "early", 0
        self._trace: dict[str, Any] = {}
        self._now = 0

    def take(self, round_: Round, known: int) -> None:
        """Takes in what happened in a round.

        Args:
            round_: The round.
            known: Episodes that have ended, in the order of their start and up to the first that hasn't.
        """
        _trace(self._trace, self._phase, round_.episodes, self._chooser.traces, self._account)
        self._chooser.traces.clear()
        self._now = round_.frames
        tenth = self._frames // 10
        if self._phase == "early" and known >= WINDOW:
            self._append()
            self._phase, self._since = "late", round_.frames
            self._chooser.clear()
        elif (
            self._phase == "late"
            and self._frames - round_.frames >= tenth
            and round_.frames - self._since >= tenth
        ):
            self._since = round_.frames
            self._chooser.clear()

    def close(self) -> None:
        """Leaves the rest in the run's folder."""
        self._append()
        self._registry.write_document(self._run, "trace", self._trace)

    def _append(self) -> None:
        rows = self._account.weights(self._phase, self._now)
        self._registry.append_rows(self._run, "weights", rows)


def _trace(
    trace: dict[str, Any],
    phase: str,
    episodes: Sequence[Episode],
    traces: Sequence[Sequence[guides.TracedDecision]],
    account: Account,
) -> None:
    """The first solved episode of the early phase and the latest of the late; any if none is solved."""
    score = f"score_{phase}"
    for episode, decisions in zip(episodes, traces, strict=True):
        best = trace.get(score, -1.0)
        if (phase == "early" and best > 0) or (episode.score == 0 and best >= 0):
            continue
        trace[phase] = account.trace(decisions)
        trace[score] = episode.score
