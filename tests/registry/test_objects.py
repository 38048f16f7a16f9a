import hashlib
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from paddlectl.errors import IntegrityError
from paddlectl.registry.files import objects


@given(data=st.binary(max_size=2000))
def test_what_is_published_is_read_back(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("objects")
    digest = objects.publish(folder, data)
    assert digest == hashlib.sha256(data).hexdigest()
    assert objects.read(folder, digest, "policy-1") == data
    assert [path.name for path in folder.iterdir()] == [f"{digest}.safetensors"]


def test_publishing_twice_is_publishing_once(tmp_path: Path) -> None:
    assert objects.publish(tmp_path, b"same") == objects.publish(tmp_path, b"same")
    assert len(list(tmp_path.iterdir())) == 1


def test_publishing_again_heals_a_damaged_object(tmp_path: Path) -> None:
    digest = objects.publish(tmp_path, b"whole")
    objects.object_path(tmp_path, digest).write_bytes(b"torn")
    objects.publish(tmp_path, b"whole")
    assert objects.read(tmp_path, digest, "policy-1") == b"whole"


def test_the_bytes_are_synced_before_their_name_appears_and_the_folder_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def watched_fsync(handle: int) -> None:
        steps.append("folder" if str(Path(f"/proc/self/fd/{handle}").readlink()) == str(tmp_path) else "file")
        fsync(handle)

    def watched_replace(self: Path, target: Path) -> Path:
        steps.append("rename")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", watched_fsync)
    monkeypatch.setattr(Path, "replace", watched_replace)
    objects.publish(tmp_path, b"weights")
    assert steps == ["file", "rename", "folder"]


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        objects.publish(tmp_path, b"weights")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_object_names_itself_and_its_owner(tmp_path: Path) -> None:
    digest = "0" * 64
    with pytest.raises(IntegrityError, match=f"policy-3.*{digest}.*missing"):
        objects.read(tmp_path, digest, "policy-3")


@pytest.mark.parametrize("digest", ["", "../../etc/passwd", "A" * 64, "0" * 63, "0" * 64 + "\n"])
def test_what_is_no_digest_opens_no_file(tmp_path: Path, digest: str) -> None:
    with pytest.raises(IntegrityError, match="names no object"):
        objects.read(tmp_path, digest, "policy-3")
