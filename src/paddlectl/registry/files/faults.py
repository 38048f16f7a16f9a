"""Faults of the disk, told as what they mean for the user."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from paddlectl.errors import PaddlectlError
from paddlectl.registry.files.rights import refused

_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NOT_ALLOWED = {errno.EACCES, errno.EPERM}


@contextmanager
def disk_faults(place: str) -> Iterator[None]:
    """Turns faults of the file system in its block into PaddlectlError.

    Args:
        place: The registry's location, for the messages.

    Raises:
        PaddlectlError: If the disk is full, or the registry's files can't be read or written.
    """
    try:
        yield
    except OSError as error:
        raise _system_fault(place, error) from error


def _system_fault(place: str, error: OSError) -> PaddlectlError:
    if error.errno in _NO_SPACE:
        return full(place)
    path = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else ""
    if error.errno in _NOT_ALLOWED and path and (refusal := refused(Path(path))):
        return PaddlectlError(refusal.what, refusal.hint)
    return PaddlectlError(f"the registry {place} can't be used ({error.strerror or error}: {path or place})")


def full(place: str) -> PaddlectlError:
    """The error for a disk without space."""
    return PaddlectlError(
        f"the disk is full: nothing more fits into the registry {place}",
        "free some space and run it again; what was stored before is whole",
    )
