"""A zip archive in one form only: equal members give equal bytes, and no other bytes are read.

Members are stored as they are, in the order given, dated 1980. What is read is packed again and compared, so
an archive can hide nothing: no link, no second name, no overlap, no comment, no path that leads elsewhere.
"""

import io
import re
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path

from paddlectl.errors import IntegrityError, NotFoundError
from paddlectl.registry.fields import TABLE

LARGEST = 64 << 20
"""Bytes of an archive; what is learned takes a tenth of it."""

_MOST_MEMBERS = 64
_NAME = re.compile(rf"[A-Za-z][A-Za-z0-9_]{{0,63}}(/{TABLE})?\.[a-z]{{1,16}}")
_DATE = (1980, 1, 1, 0, 0, 0)
_MODE = 0o100644
_UNIX = 3
_FAULTS = (
    zipfile.BadZipFile,
    NotImplementedError,
    RuntimeError,
    OSError,
    EOFError,
    struct.error,
    ValueError,
    LookupError,
)


def pack(members: Mapping[str, bytes]) -> bytes:
    """The archive of these members, in their order."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, data in members.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.external_attr, info.create_system = _MODE << 16, _UNIX
            archive.writestr(info, data)
    return file.getvalue()


def unpack(data: bytes, where: str) -> dict[str, bytes]:
    """The members of an archive that `pack` gave.

    Raises:
        IntegrityError: If it is anything else.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if len(entries) > _MOST_MEMBERS or sum(entry.file_size for entry in entries) > len(data):
                raise IntegrityError(f"{where} is no bundle: more in it than there can be")
            for entry in entries:
                if not _NAME.fullmatch(entry.filename) or entry.compress_type != zipfile.ZIP_STORED:
                    raise IntegrityError(
                        f"{where} is no bundle: {entry.filename[:80]!r} doesn't belong in one"
                    )
            members = {entry.filename: archive.read(entry) for entry in entries}
    except _FAULTS as error:
        raise IntegrityError(f"{where} is no bundle: {str(error)[:100]!r}", _HINT) from None
    if pack(members) != data:
        raise IntegrityError(f"{where} isn't what export wrote", _HINT)
    return members


def load(path: Path) -> bytes:
    """The bytes of a file that may be an archive.

    Raises:
        NotFoundError: If there is no such file.
        IntegrityError: If it is no plain file, or too large.
    """
    if not path.exists():
        raise NotFoundError(f"no file {path}", "run: paddlectl registry export --help")
    if not path.is_file() or path.stat().st_size > LARGEST:
        raise IntegrityError(f"{path} is no bundle: no file, or larger than {LARGEST >> 20} MiB", _HINT)
    with path.open("rb") as file:
        return file.read(LARGEST)


_HINT = "have it exported again"
