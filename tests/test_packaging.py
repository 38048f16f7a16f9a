"""What is built and installed without a checkout, where the tour runs; and what the package depends on."""

import os
import shutil
import site
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from samples import ROOT

BUILD = """
import sys
from setuptools import build_meta
print(getattr(build_meta, sys.argv[1])(sys.argv[2]))
"""
SHIPPED = """
from paddlectl import shipped
from paddlectl.studies.study import load_study
print(shipped.__file__, len(load_study(shipped.study("paper/fig6b")).scenarios))
"""


def ran(*line: object, cwd: Path) -> str:
    """What a process says that knows neither the checkout nor a registry of the user."""
    variables = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PADDLE"))
    }
    done = subprocess.run(
        [*map(str, line)], cwd=cwd, env=variables, capture_output=True, text=True, timeout=200, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def built(what: str, source: Path, folder: Path) -> Path:
    return folder / ran(sys.executable, "-c", BUILD, f"build_{what}", folder, cwd=source).split()[-1]


def held(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What of the project decides what is built."""
    copy = tmp_path_factory.mktemp("checkout")
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "CHANGELOG.md"):
        shutil.copy(ROOT / name, copy)
    for name in ("src", "scenarios", "tests"):
        made = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=made)
    return copy


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("wheel", checkout, tmp_path_factory.mktemp("wheel"))


def test_a_wheel_holds_all_files_of_the_package(checkout: Path, wheel: Path) -> None:
    package = checkout / "src" / "paddlectl"
    kept = {path.relative_to(package.parent) for path in package.rglob("*") if path.is_file()}
    kept |= {
        Path("paddlectl", path.relative_to(checkout)) for path in (checkout / "scenarios").rglob("*.yaml")
    }
    found = held(wheel)
    assert {Path(name) for name in found if name.startswith("paddlectl/")} == kept
    for name in (
        "py.typed",
        "scenarios/paper/fig4.yaml",
        "schemas/runs.json",
        "report/templates/page.html.j2",
    ):
        assert f"paddlectl/{name}" in found
    assert any(name.startswith("paddlectl/registry/migrations/versions/0001") for name in found)


def test_a_source_distribution_builds_the_same_wheel(checkout: Path, wheel: Path, tmp_path: Path) -> None:
    archive = built("sdist", checkout, tmp_path)
    shutil.unpack_archive(archive, tmp_path, filter="data")
    unpacked = tmp_path / archive.name.removesuffix(".tar.gz")
    assert not (unpacked / "tests").exists()
    assert held(built("wheel", unpacked, tmp_path)) == held(wheel)


def test_the_tour_runs_where_it_is_installed(wheel: Path, tmp_path: Path) -> None:
    """In an environment that borrows what the package depends on, and nothing of the checkout."""
    ran(sys.executable, "-m", "venv", "--without-pip", "installed", cwd=tmp_path)
    python = tmp_path / "installed" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", "--quiet"]
    ran(*pip, wheel, cwd=tmp_path)
    (packages,) = (tmp_path / "installed" / "lib").glob("python3.*/site-packages")
    (packages / "borrowed.pth").write_text("\n".join(site.getsitepackages()))
    (work := tmp_path / "work").mkdir()

    def typed(line: str) -> str:
        return ran(python.parent / "paddlectl", *line.split(), cwd=work)

    file, scenarios = ran(python, "-c", SHIPPED, cwd=work).split()
    assert Path(file).is_relative_to(packages) and scenarios == "5"
    assert typed("--version").startswith("paddlectl 0.")
    assert "BlockedBoxUnlockPickup" in typed("tasks")
    assert "Scenario A: BlockedBoxUnlockPickup" in typed("transfer A --method hdm --seed 0 --frames 1")
    assert "run-1: hdm on BlockedBoxUnlockPickup" in typed("explain latest")
    assert "policy-1" in typed("policies")


def needed() -> dict[str, list[Requirement]]:
    """What the project names, by the extra or other place where it does."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    places = {"build": project["build-system"]["requires"], "": project["project"]["dependencies"]}
    places |= project["project"]["optional-dependencies"]
    return {place: [Requirement(text) for text in texts] for place, texts in places.items()}


def locked(name: str) -> dict[str, Version]:
    """Of each package the one version that a lock file names, with hashes of its files."""
    text = (ROOT / ".ci" / f"{name}.lock").read_text().replace("\\\n", "")
    lines = [line for line in text.splitlines() if line[0] not in "#-"]
    assert all("--hash=sha256:" in line for line in lines)
    found = [Requirement(line.partition("--hash")[0]) for line in lines]
    assert all(str(each.specifier).startswith("==") for each in found)
    return {canonicalize_name(each.name): Version(str(each.specifier)[2:]) for each in found}


def test_what_is_depended_on_has_bounds() -> None:
    for each in (each for place in needed().values() for each in place):
        assert sorted(bound.operator for bound in each.specifier) == ["<", ">="], each
    (torch,) = (each for each in needed()[""] if each.name == "torch")
    assert not torch.specifier.contains("2.9")


def test_the_lock_file_names_exact_versions_within_the_bounds() -> None:
    versions = locked("requirements")
    for each in (each for place in ("build", "", "maze", "dev") for each in needed()[place]):
        assert each.specifier.contains(versions[canonicalize_name(each.name)]), each
    cuda, (cpu,) = locked("torch-cuda"), locked("torch-cpu").values()
    assert cpu.public == cuda["torch"].public == versions["torch"].public
    assert all(versions[name] == cuda[name] for name in versions.keys() & cuda.keys())
    for name in ("requirements", "torch-cuda"):
        assert "://" not in (ROOT / ".ci" / f"{name}.lock").read_text(), "no index is named"
