"""When a run keeps a checkpoint, when it stops, and how it goes on."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from paddlectl.errors import IntegrityError, UsageError
from paddlectl.experiments import snapshot
from paddlectl.experiments.log import RunLog
from paddlectl.experiments.stop import Stop
from paddlectl.registry.index.queries import next_step
from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

EVERY = 30.0
"""Seconds between two checkpoints: what a killed run loses at most, and a round."""

NEAR = 0.05
"""Share of its budget by which a run may end sooner without a word."""
SHARE = 0.05
"""Of a run's time that its checkpoints may take, at most; large ones are kept more seldom then."""


class Checkpointer:
    """Keeps the checkpoints of one run.

    Args:
        every: Seconds between two checkpoints; 0 for one after each round.
        stop: Asked whether to end.
        resumed: The run to go on with; None for a new one.
        tell: Told of checkpoints that had to be left out, and of budgets that are too small.
        begun: Told of the run once it is in the registry.
    """

    def __init__(
        self,
        every: float = EVERY,
        stop: Stop | None = None,
        resumed: str | None = None,
        tell: Callable[[str], None] = lambda _: None,
        begun: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.every = every
        self.stop = stop or Stop()
        self.resumed = resumed
        self.tell = tell
        self.begun = begun

    def begin(self, registry: Registry, new: Callable[[], RunRecord]) -> RunRecord:
        """The run that goes on, or a new one.

        Raises:
            UsageError: If that one is finished, or came from elsewhere.
            RegistryBusyError: If it goes on in another process.
        """
        if self.resumed is None:
            run = new()
        else:
            with registry.files.hold(self.resumed):
                run = registry.resume_run(self.resumed)
        self.begun(run.id)
        return run

    def tell_of_rounds(self, frames: int, round_: int) -> None:
        """Says how many frames are run where whole rounds come to clearly less than a budget, or to more."""
        whole = max(1, frames // round_) * round_
        if self.resumed is None and abs(whole - frames) > NEAR * frames:
            self.tell(f"{whole:,} frames are run instead of {frames:,}: whole rounds of {round_:,}")

    @contextmanager
    def rounds(self, registry: Registry, log: RunLog, roots: dict[str, Any]) -> Iterator[Callable[[], None]]:
        """Within it the run goes on, from its last checkpoint if it is resumed.

        Args:
            registry: Where the checkpoints are kept.
            log: The run's.
            roots: All that changes while it goes on.

        Returns:
            To be called after each round.

        Raises:
            PaddlectlError: If one of them holds what can't be captured, before anything is learned.
            IntegrityError: If the run has checkpoints, but none that can be used.
        """
        kept = {**roots, "curve": log.curve}
        begun = snapshot.digest(kept)
        if self.resumed is not None:
            self._rewind(registry, log, kept, begun)
        due = time.monotonic() + self.every

        def after_round() -> None:
            nonlocal due
            stopping = self.stop.asked
            if not stopping and time.monotonic() < due:
                return
            if stopping:
                signal.setitimer(signal.ITIMER_REAL, 0)
            began = time.monotonic()
            tree, arrays = snapshot.capture(kept)
            registry.files.save_checkpoint(log.run, {"begun": begun, "state": tree, **log.counts()}, arrays)
            took = time.monotonic() - began
            due = time.monotonic() + max(self.every, took / SHARE if self.every else 0.0)
            if stopping:
                raise KeyboardInterrupt

        self.stop.between_rounds = True
        try:
            yield after_round
        finally:
            self.stop.between_rounds = False
            if self.stop.asked:
                signal.setitimer(signal.ITIMER_REAL, 0)

    def _rewind(self, registry: Registry, log: RunLog, kept: dict[str, Any], begun: str) -> None:
        found = registry.files.rewind(log.run)
        if found is None:
            self.tell(f"{log.run} has no checkpoint, so it starts from its beginning")
            log.go_on(0, 0.0)
            return
        for damaged in found.skipped:
            self.tell(f"an earlier checkpoint is used, since {damaged}")
        if found.document.get("begun") != begun:
            raise IntegrityError(
                "what was saved doesn't fit this version: it would begin the run otherwise", snapshot.HINT
            )
        snapshot.restore(kept, found.document["state"], found.arrays)
        log.go_on(found.document["frames"], found.document["seconds"])


def require_resumable(run: RunRecord) -> None:
    """Refuses a run that can't go on here.

    Raises:
        UsageError: If it is finished, came from elsewhere, or learned nothing.
    """
    if run.status == "finished":
        raise UsageError(f"{run.id} is finished", next_step(run))
    if run.method == "random" or any(source.startswith(ELSEWHERE) for source in run.sources):
        raise UsageError(f"{run.id} can't go on here", "start it anew")
