"""Users of one folder with a group: what each makes under a strict umask, the others read and go on with."""

import os
import random
import stat
from functools import partial
from pathlib import Path
from typing import Any

from filler import ARRAYS, Filler
from paddlectl.errors import RegistryBusyError
from paddlectl.registry.care.check import check
from paddlectl.registry.files import checkpoints
from paddlectl.registry.store import Registry
from trials.crowds import together

USERS, EACH = 4, 2
FIRST, GROUP = 61_000, 61_000  # ids that nobody has
MASKS = (0o077, 0o027, 0o022, 0o002, 0o000)


def shared_folders(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many registries, each written to by several processes of four users at once, with any umask."""
    if os.getuid() != 0:
        return {"registries": 0, "skipped": "only root can become other users"}
    from alembic import command  # noqa: F401 - not to be read by every user

    dice, files, resumed = random.Random(seed), 0, 0
    folder.chmod(0o755)
    Filler(Registry.open(folder / "warm")).all_kinds()  # loads what only root may
    for number in range(count):
        place = folder / f"registry-{number}"
        place.mkdir()
        os.chown(place, -1, GROUP)
        place.chmod(dice.choice([0o2770, 0o2775, 0o770]))
        answers = folder / f"answers-{number}"
        answers.mkdir()
        answers.chmod(0o777)
        works = [
            partial(_use, place, FIRST + worker % USERS, dice.choice(MASKS)) for worker in range(USERS * EACH)
        ]
        resumed += sum(together(works, answers))
        report = check(place, read_data=True)
        assert not report.faults and len(report.rows) == 5 * len(works), report.faults
        for path in place.rglob("*"):
            found, above = path.stat(), place.stat().st_mode
            wanted = above & 0o2777 if path.is_dir() else above & 0o666
            assert (stat.S_IMODE(found.st_mode), found.st_gid) == (wanted, GROUP), (path, oct(found.st_mode))
            files += 1
    return {"registries": count, "users": USERS, "files": files, "resumed": resumed, "lost": 0}


def _use(place: Path, user: int, mask: int) -> int:
    """Runs of its own, and then one of another's: read, and gone on with."""
    os.setgroups([GROUP])
    os.setgid(user)
    os.setuid(user)
    os.umask(mask)
    with Registry.open(place) as registry:
        add = Filler(registry)
        for _ in range(2):
            run = add.run(seed=user).id
            registry.files.append_rows(run, "episodes", [{"order": 0}])
            add.policy(run, checkpoint=ARRAYS)
            registry.finish_run(run, status="finished", frames=1, episodes=1, seconds=1.0, results={})
        stopped = add.run(seed=user).id
        with registry.files.hold(stopped):
            registry.files.save_checkpoint(stopped, {}, ARRAYS)
        for policy in registry.policies():
            assert registry.read_checkpoint(policy) == ARRAYS
            assert registry.files.read_rows(policy.run, "episodes") in ([{"order": 0}], [])
        gone_on = sum(_gone_on(registry, run.id) for run in registry.runs() if run.seed != user)
        assert not check(place).faults
    return gone_on


def _gone_on(registry: Registry, run: str) -> bool:
    """Whether it was another's, stopped, and can be gone on with."""
    if not checkpoints.numbers(registry.folder / "runs" / run):
        return False
    try:
        with registry.files.hold(run):
            registry.resume_run(run)
            registry.files.rewind(run)
            registry.files.append_rows(run, "episodes", [{"order": 1}])
            registry.files.save_checkpoint(run, {}, ARRAYS)
    except RegistryBusyError:
        return False
    return True
