"""What `registry check` finds, and how much it looked at."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from paddlectl.registry.files.manifests import Manifest


class Finding(NamedTuple):
    """One thing that isn't as it should be.

    Attributes:
        kind: A word or two, the same for the same kind of thing.
        where: The run, policy or file.
        what: For people.
        fault: Something was lost or changed; otherwise it is only left over, and `gc` or `resume` is for it.
    """

    kind: str
    where: str
    what: str
    fault: bool = True


@dataclass
class Report:
    """What a check found, and how much it looked at.

    Attributes:
        rows: Of the index, by the name of the run or policy.
        readable: Whether the index and its tables could be read.
        sealed: Files that are there and that a manifest knows.
        bytes: Read and hashed; 0 for a check of the structure.
    """

    findings: list[Finding] = field(default_factory=list)
    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    manifests: dict[str, Manifest] = field(default_factory=dict)
    readable: bool = False
    sealed: set[str] = field(default_factory=set)
    bytes: int = 0

    def add(self, kind: str, where: str, what: str, *, fault: bool = True) -> None:
        self.findings.append(Finding(kind, where, what, fault))

    @property
    def files(self) -> int:
        return len(self.sealed)

    @property
    def older(self) -> bool:
        """Whether the registry is of an earlier schema, which the next use upgrades."""
        return any(finding.kind == "older schema" for finding in self.findings)

    @property
    def faults(self) -> list[Finding]:
        return [finding for finding in self.findings if finding.fault]


def entries(folder: Path) -> list[Path]:
    """What is in a folder, if that is there."""
    try:
        return sorted(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []


def inside(folder: Path, path: Path) -> str:
    """What a file is called in a finding: its path within the registry."""
    return path.relative_to(folder).as_posix()
