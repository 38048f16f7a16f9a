"""How a run's process is stopped: by SIGTERM, between two rounds. Without torch, for it comes first."""

import signal
from types import FrameType

PATIENCE = 2.0
"""Seconds that a run which is asked to stop has to end its round, so that it can keep a checkpoint."""


class Stop:
    """SIGTERM to a run's process: it ends between two rounds, or at once where there are none."""

    def __init__(self) -> None:
        self.asked = False
        self.between_rounds = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if not self.between_rounds:
            raise KeyboardInterrupt
        self.asked = True
        signal.signal(signal.SIGALRM, _at_once)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)


def _at_once(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
