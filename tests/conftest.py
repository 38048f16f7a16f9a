import os
import signal
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before anything imports numpy or torch

# A busy machine takes longer than the usual 200 ms for an example. All else is as usual, also what CI has.
settings.register_profile("patient", settings(), deadline=None)
settings.load_profile("patient")

# A shell's background job has ^C ignored, and hands that down to the processes that the tests stop by it.
signal.signal(signal.SIGINT, signal.default_int_handler)


LONGEST = (
    "test_resume",
    "test_trials",
    "test_evaluation",
    "test_run_jobs",
    "test_start_up",
    "test_every_method",
    "test_openness",
    "test_care",
    "test_signals",
    "test_packaging",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take longest come first, so that no process waits for one of them at the end."""
    items.sort(key=lambda item: item.path.stem not in LONGEST)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A file's tests are run by one process, so that what they share is made once."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)


@pytest.fixture(autouse=True)
def hears_what_it_heard() -> Iterator[None]:
    """The command line, run in this process, leaves signals ignored, and processes inherit that."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
