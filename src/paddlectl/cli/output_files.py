"""Files that a user names to write: what may be replaced, and how it is told if they can't be written."""

from pathlib import Path

from paddlectl.errors import UsageError


def require_output(path: Path, *suffixes: str) -> None:
    """Makes sure of a file's name before anything is done for it.

    Args:
        path: The file; one that is there is replaced.
        suffixes: With which its name may end, so that nothing else is replaced by mistake.

    Raises:
        UsageError: If it ends otherwise, is no plain file, or its folder isn't there.
    """
    if path.suffix.lower() not in suffixes:
        raise UsageError(f"{path} doesn't end in {' or '.join(suffixes)}", "name a file that does")
    try:
        there, plain, folder = path.exists() or path.is_symlink(), _is_plain(path), path.parent.is_dir()
    except OSError as error:
        raise unwritable(path, error) from error
    if not folder:
        raise UsageError(f"{path} can't be written: there is no folder {path.parent}", "make it first")
    if there and not plain:
        raise UsageError(f"{path} is there, and no plain file", "name another file")


def write_output(path: Path, data: bytes) -> None:
    """Writes it whole, or not at all.

    Raises:
        UsageError: If it can't be.
    """
    from paddlectl.registry.files.objects import write_atomically

    try:
        write_atomically(path, data, shared=False)
    except OSError as error:
        raise unwritable(path, error) from error


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def unwritable(path: Path, error: OSError) -> UsageError:
    """How it is told that a file can't be written."""
    return UsageError(f"{path} can't be written: {error.strerror}", "name a file elsewhere")
