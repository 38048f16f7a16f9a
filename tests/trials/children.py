"""Processes that tests start, and those that they start."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any


def child(work: Any, *given: Any) -> int:
    """Starts work in a forked process, which has loaded what this one has: it begins within milliseconds."""
    process = os.fork()
    if process:
        return process
    try:
        work(*given)
        os._exit(0)
    except BaseException as error:
        print(f"{type(error).__name__}: {error}", flush=True)
    os._exit(1)


def jobs_at_work() -> dict[int, int]:
    """The processes that run jobs, whoever started them, with their parents. It needs `/proc`."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if b"spawn_main" in (folder / "cmdline").read_bytes():
                found[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
    return found
