"""State as JSON and arrays, and back: nothing forgotten, no sharing lost, nothing restored only nearly."""

import json
import socket
import subprocess
import sys
from collections import defaultdict, deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, Flag
from functools import cached_property, partial
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from paddlectl import plugins
from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.experiments import snapshot
from paddlectl.learners.ppo import PPO
from paddlectl.learners.td3 import _best
from paddlectl.logic.atoms import Predicate


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


class Phase(Enum):
    EARLY = "early"
    LATE = "late"


class Marks(Flag):
    ONE = 1
    TWO = 2


class Foreign:
    """Of another project, and all its own affair."""

    def __init__(self, *steps: int) -> None:
        self._hidden = {*steps}

    def snapshot(self) -> list[int]:
        return sorted(self._hidden)

    def restore(self, steps: list[int]) -> None:
        self._hidden = {*steps}


class Hidden(torch.nn.Module):
    """A network with more to it than its `state_dict` tells."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(1, 1)
        self.register_buffer("mean", torch.zeros(2), persistent=False)
        self.steps = 0


@dataclass(frozen=True)
class Holder:
    """Frozen, but not what it holds; of another project, as far as anyone knows."""

    held: Any
    name: str = "holder"

    @cached_property
    def title(self) -> str:
        return self.name.title()


@dataclass(frozen=True, slots=True)
class Slotted:
    held: Any


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
    for kind in (Pair, Numbers, Late, Simulator, Everything, SimpleHolder):
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
    with pytest.raises(PaddlectlError) as caught:
        snapshot.capture({"it": it})
    assert str(caught.value) == (
        "it.table.a[4]: a socket of module socket can't be captured: give it snapshot() and restore()"
    )


@pytest.mark.parametrize(
    "change",
    [
        lambda it: setattr(it, "network", torch.nn.Linear(4, 2)),
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


def went_through(before: Any, now: Any) -> Any:
    """What becomes of `before`, made as at the start, when it is put where `now` was captured."""
    tree, arrays = snapshot.capture({"it": now})
    roots = {"it": before}
    snapshot.restore(roots, json.loads(json.dumps(tree)), arrays)
    return roots["it"]


def ppo(steps: int) -> PPO:
    learner = PPO(2, 2, 0)
    learner.rng.random(steps)
    return learner


@pytest.mark.parametrize("kind", [Holder, Slotted, lambda held: MappingProxyType({"held": held})])
@pytest.mark.parametrize(
    ("before", "now", "told"),
    [
        (np.zeros(3), np.arange(3.0), lambda held: held.tolist()),
        ([1], [1, 2], lambda held: held),
        ({}, {"a": [np.float32(0.5)]}, lambda held: held),
        (ppo(0), ppo(7), lambda held: held.rng.random()),
        (Foreign(), Foreign(1, 2), Foreign.snapshot),
        ((3, []), (3, [4]), lambda held: held),
        (Holder([1]), Holder([2]), lambda held: held.held),
        (np.random.default_rng(0).random, np.random.default_rng(1).random, lambda held: held(3).tolist()),
    ],
)
def test_what_is_frozen_is_no_constant_for_all_that(
    kind: Callable[[Any], Any], before: Any, now: Any, told: Callable[[Any], Any]
) -> None:
    def of(value: Any) -> Any:
        return value["held"] if isinstance(value, MappingProxyType) else value.held

    there = kind(before)
    found = went_through(there, kind(now))
    assert found is there, "others may refer to it"
    assert told(of(found)) == told(now)


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (Phase.EARLY, Phase.LATE),
        (Marks.ONE, Marks.ONE | Marks.TWO),
        (b"a", b"\xff"),
        ("a", "b"),
        (1, True),
        (0.0, -0.0),
        (np.float64(1.0), 1.0),
        (1.0, np.float64(1.0)),
        ((Phase.EARLY, 1), (Phase.LATE, 1)),
        (frozenset("ab"), frozenset({"b", Phase.LATE, (1, 2)})),
        (Numbers(), Numbers(0.1, (5,), "x")),
        (Holder(None), Holder(frozenset({Numbers(2.0)}))),
        (Slotted(1), Slotted(float("inf"))),
        (MappingProxyType({"a": 1}), MappingProxyType({"b": 2})),
        (Pair(1, 2), Pair(Phase.LATE, None)),
        (None, Pair(Numbers(), Holder(Slotted(Phase.LATE)))),
        (None, np.arange(3)[::-1]),
        (None, {Numbers(): [frozenset({1.5})]}),
    ],
)
def test_a_constant_that_another_took_the_place_of_comes_back(before: Any, now: Any) -> None:
    found = went_through(SimpleHolder(before), SimpleHolder(now)).held
    assert type(found) is type(now)
    if isinstance(now, frozenset):  # its order is no part of it
        found, now = (sorted(map(repr, value)) for value in (found, now))
    assert repr(found) == repr(now)


def test_a_constant_that_is_the_same_stays_the_object_that_it_was() -> None:
    for value in (Numbers(), (Phase.LATE, frozenset({Numbers(0.5)})), Holder("a"), Slotted((1, 2.5, None))):
        assert went_through(value, value) is value


def test_what_is_worked_out_from_constants_plays_no_part() -> None:
    fresh, asked = Predicate("far", 0)(), Predicate("far", 0)()
    assert asked.text == "far()"
    assert snapshot.capture({"it": fresh}) == snapshot.capture({"it": asked})


def test_equal_constants_are_one_or_two_objects_alike() -> None:
    sizes = tuple(int(size) for size in "34")
    one = [Numbers(sizes=sizes), Numbers(sizes=sizes), sizes]
    two = [Numbers(sizes=tuple([3, 4])), Numbers(sizes=tuple([3, 4])), tuple([3, 4])]
    assert snapshot.capture({"it": one}) == snapshot.capture({"it": two})


@pytest.mark.parametrize(
    "make", [lambda: np.zeros(2), lambda: [0], lambda: {"a": 0}, lambda: torch.zeros(2), lambda: Late(None)]
)
def test_what_was_one_object_at_the_start_may_be_two_later(make: Callable[[], Any]) -> None:
    shared = make()
    found = went_through([shared, shared, shared], [one := make(), make(), one])
    assert found[0] is shared is found[2] and found[1] is not shared


SETS = """
from paddlectl.experiments import snapshot
print(snapshot.digest({"it": frozenset("abcdefgh")}))
"""


def test_a_set_is_captured_alike_in_every_process() -> None:
    environment = {"PYTHONPATH": ":".join(sys.path), "PYTHONHASHSEED": "1"}
    done = subprocess.run([sys.executable, "-c", SETS], env=environment, capture_output=True, check=True)
    here = snapshot.digest({"it": frozenset("abcdefgh")})
    assert done.stdout.decode().strip() == here


def counting(start: int) -> Callable[[], int]:
    count = start

    def count_on() -> int:
        nonlocal count
        count += 1
        return count

    return count_on


def test_what_a_function_has_to_work_with_is_kept() -> None:
    assert went_through(counting(0), counting(7))() == 8
    assert went_through(partial(max, [1], key=None), partial(max, [5], key=None))() == 5
    with pytest.raises(IntegrityError):
        went_through(partial(max, 1, 2), partial(max, 3, 4))  # nothing in it can be changed
    with pytest.raises(IntegrityError):
        went_through(SimpleHolder(max), SimpleHolder(min))


def test_what_decorates_a_function_of_a_module_is_code() -> None:
    """As `torch.no_grad` does, which nothing could capture."""
    assert went_through(partial(_best, [1]), partial(_best, [2])).args == ([2],)


def test_all_of_a_network_is_kept() -> None:
    now = Hidden().eval()
    now.steps = 4
    now.mean += 1.0
    found = went_through(Hidden(), now)
    assert (found.steps, found.mean.tolist()) == (4, [1.0, 1.0])
    assert not found.training and not found.layer.training


class SimpleHolder:
    def __init__(self, held: Any) -> None:
        self.held = held


def test_any_class_that_offers_it_is_taken() -> None:
    there = Foreign(1)
    assert went_through(there, Foreign(2, 3)) is there and there.snapshot() == [2, 3]
    assert went_through([None], [Foreign(2)])[0].snapshot() == [2], "made only after the start"
    assert went_through(SimpleHolder(Numbers()), SimpleHolder(Foreign(4))).held.snapshot() == [4]


class Plain:
    """A plug-in's."""

    def __init__(self, steps: int) -> None:
        self.steps = [steps]

    @property
    def trap(self) -> int:
        return 0

    @trap.setter
    def trap(self, value: int) -> None:
        raise AssertionError("run by what was saved")


class Guarded(Plain):
    def __del__(self) -> None:
        pass


class Made(Plain):
    def __new__(cls, steps: int) -> "Made":
        return super().__new__(cls)


class Setting(Plain):
    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)


def test_plain_classes_of_plug_ins_in_use_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PaddlectlError, match="a Plain of module"):
        snapshot.capture({"it": Plain(1)})
    monkeypatch.setattr(plugins, "packages", {*plugins.packages, Plain.__module__.partition(".")[0]})
    there = Plain(1)
    assert went_through(there, Plain(2)) is there and there.steps == [2]
    assert went_through([None], [Plain(3)])[0].steps == [3]
    for odd in (Guarded(1), Made(1), Setting(1)):
        with pytest.raises(PaddlectlError, match="give it snapshot"):
            snapshot.capture({"it": odd})


@pytest.mark.parametrize("kind", [Guarded, Made, Setting])
def test_no_code_of_a_plug_in_runs_for_what_was_saved(
    kind: type[Plain], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugins, "packages", {*plugins.packages, Plain.__module__.partition(".")[0]})
    tree, arrays = snapshot.capture({"it": [Plain(1)]})
    text = json.dumps(tree)
    for forged, told in (
        (text.replace('Plain"', f'{kind.__name__}"'), "isn't of this project"),
        (text.replace('"steps"', '"trap"'), "trap of .* isn't stored"),
        (text.replace('"steps"', '"__class__"'), "__class__ of .* isn't stored"),
    ):
        with pytest.raises(IntegrityError, match=told):
            snapshot.restore({"it": [None]}, json.loads(forged), arrays)


class Half:
    def snapshot(self) -> int:
        return 1


class Words(dict[str, int]):
    """Of the project, and yet more than its attributes."""


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (Half(), "a Half of module"),
        (SimpleNamespace(), "a SimpleNamespace of module types"),
        ({1, 2}, "a set of module builtins"),
        (deque([1]), "a deque of module collections"),
        (defaultdict(int), "a defaultdict of module collections"),
        (Words(a=1), "a Words of module paddlectl.stood_in"),
        (bytearray(b"a"), "a bytearray of module builtins"),
        (1j, "a complex of module builtins"),
        (iter([1]), "a list_iterator of module builtins"),
        (np.ma.masked_array([1.0], [True]), "a MaskedArray of module numpy.ma"),
        (np.array(["a"]), "a str32 ndarray of module numpy"),
        (np.array([None]), "a object ndarray of module numpy"),
        (np.zeros(1, np.complex128), "a complex128 ndarray of module numpy"),
        (torch.zeros(1, dtype=torch.bfloat16), "a torch.bfloat16 Tensor of module torch"),
        (torch.zeros(2).to_sparse(), "a torch.float32 Tensor of module torch"),
        (np.random.RandomState(0), "a RandomState of module numpy.random.mtrand"),
        (Holder(socket.socket), None),
        (Holder([Half()]), "learning.it.held[0]: a Half of module"),
        ({Half(): 1}, "learning.it, a key: a Half of module"),
        (frozenset({Half()}), "learning.it, an item: a Half of module"),
    ],
)
def test_what_cant_be_captured_is_named(
    value: Any, told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Words, "__module__", "paddlectl.stood_in")
    if told is None:
        snapshot.capture({"learning": {"it": value}})
        return
    with pytest.raises(PaddlectlError) as caught:
        snapshot.capture({"learning": {"it": value}})
    message = str(caught.value)
    assert told in message and message.startswith("learning.it") and "\n" not in message
    assert message.endswith("can't be captured: give it snapshot() and restore()")


@pytest.mark.parametrize(
    ("there", "name", "told"),
    [
        (Late(Numbers()), "subprocess.Popen", "isn't of this project"),
        (Late(Numbers()), "paddlectl.experiments.snapshot.PurePath", "is loaded"),
        (Late(Numbers()), "paddlectl.experiments.snapshot.torch.nn.Linear", "is loaded"),
        (Late(Numbers()), "this.Zen", "is loaded"),
        (Late(Numbers()), "", "is loaded"),
        (Foreign(1), "subprocess.Popen", r"has no snapshot\(\) and restore\(\)"),
        (Foreign(1), "antigravity.Foreign", "is loaded"),
        (SimpleHolder([Pair(1, [2])]), "subprocess.Popen", "is no named tuple"),
        (SimpleHolder([Phase.LATE]), "subprocess.Popen", "is no enum"),
    ],
)
def test_nothing_that_is_named_is_imported_or_run(there: Any, name: str, told: str) -> None:
    tree, arrays = snapshot.capture({"it": there})
    kinds = {f"{kind.__module__}.{kind.__qualname__}" for kind in (Late, Foreign, Pair, Phase)}
    text = json.dumps(tree)
    for kind in kinds:
        text = text.replace(f'"{kind}"', f'"{name}"')
    loaded = set(sys.modules)
    with pytest.raises(IntegrityError, match=told):
        snapshot.restore(
            {"it": None if isinstance(there, Late | Foreign) else SimpleHolder([None])},
            json.loads(text),
            arrays,
        )
    assert set(sys.modules) == loaded
