"""The package's rules on imports, read from the source: direction, cycles, and each package's home room."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "paddlectl"
FLOOR = {
    "cli": 5, "__main__": 6, "api": 5.5,
    "experiments": 4, "studies": 4.2, "report": 4.4, "statistics": 0,
    "methods": 3.5,  # what a method is and which there are lies below: scenarios name one
    "transfer": 3, "scenario": 3, "yaml_files": 2.6,  # below experiments, which runs scenarios
    "methods.base": 2.6, "methods.catalogue": 2.5, "methods.changes": 2.7, "ranges": -1,
    "hybrid": 2, "transfer.similarity": 2, "transfer.performance": 2, "transfer.guidance": 2,
    "shipped": 2.1, "transfer.documents": 2.1, "whole": 2.5,
    "registry": 2,  # records, names and fields; its rooms from below:
    "registry.files": 2.1, "registry.schema": 2.15, "registry.index": 2.2, "registry.migrations": 2.2,
    "registry.care": 2.3, "registry.store": 2.3, "registry.bundles": 2.4,
    "agents": 1.5,
    "tasks": 1, "learners": 1,
    "tasks.suite": 2.5,  # knows what names the registry takes
    "tasks.files": 2.7, "tasks.naming": 2.8,  # are read as all files are
    "logic": 0, "plugins": 0, "errors": -1,
}  # fmt: skip
HOMES = {
    "torch": {"learners", "agents", "hybrid", "transfer", "methods", "experiments"},
    "gymnasium": {"tasks"}, "minigrid": {"tasks"}, "gymnasium_robotics": {"tasks"}, "mujoco": {"tasks"},
    "psycopg": {"registry.index"}, "alembic": {"registry.index", "registry.migrations"},
    "sqlalchemy": {
        "registry.schema", "registry.index", "registry.migrations",
        "registry.care", "registry.store", "registry.bundles",
    },
    "safetensors": {"registry.care", "registry.bundles", "experiments", "learners", "hybrid"},
    "pydantic": {"scenario", "studies", "yaml_files", "tasks.files"}, "pydantic_core": {"scenario"},
    "yaml": {"yaml_files"},
    "rich": {"report"}, "matplotlib": {"report"}, "jinja2": {"report"},
    "PIL": {"report", "tasks"},
    "ray": {"experiments"}, "pyarrow": {"report"}, "tensorboard": {"report"}, "typer": {"cli"},
}  # fmt: skip
EVERYWHERE = {"numpy"}
BANNED = {"pickle", "dill", "joblib", "tarfile", "shelve", "marshal"}
STANDARD_ONLY = {"logic", "plugins", "errors"}

MODULES = {
    path: ".".join(path.relative_to(SOURCE).with_suffix("").parts)
    for path in SOURCE.rglob("*.py")
    if path.name != "__init__.py"
}


def room_of(module: str) -> str:
    return next(room for room in sorted(FLOOR, key=len, reverse=True) if f"{module}.".startswith(f"{room}."))


def imports_of(path: Path) -> Iterator[str]:
    """Every module named in an import, wherever it stands; `from a import b` names a and a.b."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level and node.module, f"{path}: write imports in full"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def house_imports(path: Path) -> set[str]:
    named = {name.removeprefix("paddlectl.") for name in imports_of(path) if name.startswith("paddlectl.")}
    return named & set(MODULES.values())


@pytest.mark.parametrize("path", MODULES, ids=MODULES.values())
def test_imports_run_downward(path: Path) -> None:
    room = room_of(MODULES[path])
    for module in house_imports(path):
        other = room_of(module)
        assert other == room or FLOOR[other] < FLOOR[room], f"{MODULES[path]} imports {module}"
    if room.startswith("registry"):
        outside = {module.split(".")[0] for module in house_imports(path)}
        assert outside <= {"registry", "logic", "errors"}


@pytest.mark.parametrize("path", MODULES, ids=MODULES.values())
def test_packages_stay_at_home(path: Path) -> None:
    room = room_of(MODULES[path])
    packages = {name.split(".")[0] for name in imports_of(path)} - {"paddlectl"}
    assert not packages & BANNED
    for package in packages & set(HOMES):
        assert room in HOMES[package], f"{MODULES[path]} imports {package}"
    if room in STANDARD_ONLY:
        assert not packages & EVERYWHERE
    unknown = packages - set(HOMES) - EVERYWHERE - set(sys.stdlib_module_names)
    assert not unknown, f"no home is named for {unknown}"


def test_no_cycles() -> None:
    below = {name: house_imports(path) - {name} for path, name in MODULES.items()}
    while free := [name for name, needs in below.items() if not needs & below.keys()]:
        for name in free:
            del below[name]
    assert not below, f"these import each other: {sorted(below)}"


def test_package_files_are_empty() -> None:
    """But for the root's, whose names are found when they are asked for."""
    files = [path for path in SOURCE.rglob("__init__.py") if "migrations" not in path.parts]
    assert all(not path.read_text() for path in files if path.parent != SOURCE)
    body = ast.parse((SOURCE / "__init__.py").read_text()).body
    imported = [node for node in body if isinstance(node, ast.Import | ast.ImportFrom)]
    named = {alias.name for node in imported for alias in node.names} | {
        node.module for node in imported if isinstance(node, ast.ImportFrom)
    }
    assert {str(name).split(".")[0] for name in named} & {"paddlectl", *HOMES, *EVERYWHERE} == set()
