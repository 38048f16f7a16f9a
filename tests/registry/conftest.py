import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from filler import Filler
from paddlectl.registry.store import Registry
from postgres import Server, server


@pytest.fixture
def location(tmp_path: Path) -> Path:
    return tmp_path / "registry"


@pytest.fixture(scope="session")
def new(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(Registry.open(tmp_path_factory.mktemp("new") / "registry").location)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Server]:
    with server() as running:
        yield running


@pytest.fixture
def postgres_registry(location: Path, postgres: Server) -> Registry:
    return Registry.open(postgres.new(location))


@pytest.fixture
def sqlite_registry(location: Path, new: Path) -> Registry:
    shutil.copytree(new, location)
    return Registry.open(location)


@pytest.fixture
def registry(location: Path, new: Path) -> Registry:
    shutil.copytree(new, location)  # quicker than making one for each test
    return Registry.open(location)


@pytest.fixture
def add(registry: Registry) -> Filler:
    return Filler(registry)


@pytest.fixture(scope="session")
def filler() -> type[Filler]:
    return Filler
