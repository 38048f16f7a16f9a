"""How many CPUs this process may use, which can be fewer than the machine has."""

import math
import os
from pathlib import Path

CGROUPS = Path("/sys/fs/cgroup")
OWN = Path("/proc/self/cgroup")


def permitted() -> int:
    """CPUs that the affinity of the process and the quotas of its control groups permit; at least 1."""
    present = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([present, *(math.ceil(quota) for quota in _quotas())]))


def _quotas() -> list[float]:
    """CPUs that each control group above the process grants it, by version 2 and by version 1."""
    try:
        lines = [
            line.split(":", 2) for line in OWN.read_text(encoding="ascii", errors="replace").splitlines()
        ]
    except OSError:
        return []
    found = []
    for _, controllers, path in lines:
        root = CGROUPS / controllers if controllers else CGROUPS
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            found += _quota(folder)
            if folder == root:
                break
    return found


def _quota(folder: Path) -> list[float]:
    try:
        if (folder / "cpu.max").exists():
            quota, period = (folder / "cpu.max").read_text(encoding="ascii").split()
        else:
            quota, period = ((folder / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        return [float(quota) / float(period)] if quota != "max" and float(quota) > 0 else []
    except (OSError, ValueError):
        return []
