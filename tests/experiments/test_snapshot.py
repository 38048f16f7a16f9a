"""State as JSON and arrays, and back: nothing forgotten, no sharing lost, nothing restored only nearly."""

import json
import socket
import sys
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from paddlectl.errors import IntegrityError
from paddlectl.experiments import snapshot


class Pair(NamedTuple):
    left: Any
    right: Any


@dataclass(frozen=True)
class Numbers:
    rate: float = float("inf")
    sizes: tuple[int, ...] = (3, 4)
    name: str | None = None


class Late:
    """Made only after the start."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.ring = np.zeros((2, 3), np.float32)


class Simulator:
    """Its state isn't in an attribute that is known."""

    def __init__(self) -> None:
        self._handle = socket.socket
        self._position = [0.0]

    def snapshot(self) -> list[float]:
        return self._position

    def restore(self, value: list[float]) -> None:
        self._position = value


class Everything:
    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.same_rng = self.rng
        self.generator = torch.Generator().manual_seed(seed)
        self.network = torch.nn.Linear(3, 2)
        self.optimiser = torch.optim.Adam(self.network.parameters())
        self.counts = np.arange(6).reshape(2, 3)
        self.view = self.counts[0]
        self.table = {"a": [1, 2.5, float("-inf"), None], (1, "b"): Pair(np.bool_(True), np.float32(0.1))}
        self.names = ("x", "y")
        self.numbers = Numbers()
        self.late: Late | None = None
        self.simulator = Simulator()
        self.draw = partial(self._draw, times=2)
        self.itself = self

    def _draw(self, times: int) -> float:
        return float(sum(self.rng.random() for _ in range(times)))

    def go_on(self) -> float:
        noise = torch.rand(4, 3, generator=self.generator)
        loss = (self.network(noise) ** 2).mean() * self.draw()
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.counts += 1
        self.table["a"].append(self.same_rng.integers(10).item())
        self.late = self.late or Late(Numbers(0.5))
        self.late.ring[0] += self.counts[0]
        self.simulator._position[0] += 0.1
        return float(loss) + self.view.sum() + self.simulator._position[0]


@pytest.fixture(autouse=True)
def ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The classes of this file pass for the project's own."""
    monkeypatch.setitem(sys.modules, "paddlectl.stood_in", sys.modules[__name__])
    for kind in (Pair, Numbers, Late, Simulator, Everything):
        monkeypatch.setattr(kind, "__module__", "paddlectl.stood_in")


@pytest.mark.parametrize("steps", [0, 1, 5])
def test_what_goes_on_from_a_snapshot_is_what_goes_on(steps: int) -> None:
    torch.manual_seed(0)
    one = Everything(1)
    for _ in range(steps):
        one.go_on()
    tree, arrays = snapshot.capture({"it": one})
    tree = json.loads(json.dumps(tree))
    two = Everything(2)
    two.go_on()
    two.late = None
    snapshot.restore({"it": two}, tree, arrays)
    assert [one.go_on() for _ in range(4)] == [two.go_on() for _ in range(4)]
    assert snapshot.capture({"it": one}) == snapshot.capture({"it": two})
    assert two.same_rng is two.rng and two.itself is two and two.view.base is not None
    assert two.late is not None and two.late.numbers == Numbers(0.5)
    assert two.table[1, "b"] == Pair(np.bool_(True), np.float32(0.1))


def test_what_isnt_known_is_an_error_that_says_where() -> None:
    it = Everything(1)
    it.table["a"].append(socket.socket())
    with pytest.raises(TypeError, match=r"no way to save \.it\.table\.a\[4\], a socket\.socket"):
        snapshot.capture({"it": it})


@pytest.mark.parametrize(
    "change",
    [
        lambda it: setattr(it, "network", torch.nn.Linear(4, 2)),
        lambda it: setattr(it, "numbers", Numbers(0.1)),
        lambda it: setattr(it, "more", 1),
        lambda it: setattr(it, "rng", 3),
        lambda it: setattr(it, "simulator", None),
    ],
)
def test_another_versions_objects_are_refused(change: Any) -> None:
    tree, arrays = snapshot.capture({"it": Everything(1)})
    other = Everything(1)
    change(other)
    with pytest.raises(IntegrityError):
        snapshot.restore({"it": other}, tree, arrays)


def test_no_class_of_another_project_is_made() -> None:
    tree, arrays = snapshot.capture({"it": Late(Numbers())})
    text = json.dumps(tree).replace("paddlectl.stood_in.Late", "subprocess.Popen")
    with pytest.raises(IntegrityError, match=r"subprocess\.Popen isn't of this project"):
        snapshot.restore({"it": None}, json.loads(text), arrays)
