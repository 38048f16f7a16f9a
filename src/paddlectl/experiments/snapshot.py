"""The state of any objects of this project as JSON and flat arrays, and back into objects made alike.

What is kept isn't listed anywhere: every attribute of every object that is reached is taken, and a kind of
value that isn't known is an error. So nothing can be forgotten when a class gets a new attribute. Going back,
objects are made as at the start of a run and then overwritten; what was restored is captured once more and
must be what was stored, bit for bit.

An object whose state isn't in its attributes (a simulator's) offers `snapshot()`, which gives any value that
is known here, and `restore(value)`.
"""

import functools
import math
import sys
import types
from collections import defaultdict
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
import torch

from paddlectl.errors import IntegrityError
from paddlectl.registry.store import Registry

_PLAIN = (type(None), bool, int, str)
_CODE = (types.FunctionType, types.BuiltinFunctionType, types.ModuleType, type)
_CONSTANT = (*_CODE, frozenset, bytes, PurePath, Enum, np.dtype, torch.device, Registry)
_HOUSE = "paddlectl."


def capture(roots: dict[str, Any]) -> tuple[Any, bytes]:
    """All state that can be reached from these objects: JSON, and a safetensors file for its arrays."""
    writer = _Writer()
    tree = writer.node(roots, "")
    flat = {name: np.concatenate(parts) for name, parts in writer.arrays.items()}
    return tree, safetensors.numpy.save(flat)


def restore(roots: dict[str, Any], tree: Any, arrays: bytes) -> None:
    """Puts captured state into objects that were made as those were at first.

    Raises:
        IntegrityError: If it isn't theirs, as when another version of the program captured it.
    """
    try:
        _Reader(safetensors.numpy.load(arrays)).fill(roots, tree)
    except (*_MISFITS, safetensors.SafetensorError) as error:
        raise IntegrityError(f"what was saved doesn't fit this version: {error}"[:300], _HINT) from error
    if capture(roots) != (tree, arrays):
        raise IntegrityError("what was saved can't be restored exactly by this version", _HINT)


_MISFITS = (AttributeError, LookupError, RuntimeError, TypeError, ValueError)
_HINT = "go on with the version of paddlectl that the run began with"


class _Writer:
    """Turns values into nodes: plain JSON values as they are, all others a list that begins with a kind."""

    def __init__(self) -> None:
        self.arrays: dict[str, list[np.ndarray]] = defaultdict(list)
        self._sizes: dict[str, int] = defaultdict(int)
        self._seen: dict[int, tuple[int, Any]] = {}

    def node(self, value: Any, where: str) -> Any:
        if isinstance(value, _PLAIN) and not isinstance(value, Enum):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else ["float", repr(value)]
        if isinstance(value, np.generic):
            return ["scalar", *self._array(np.asarray(value))]
        if _is_constant(value):
            settings = _settings(value)
            return ["constant"] if settings is None else ["settings", settings]
        if id(value) in self._seen:
            return ["seen", self._seen[id(value)][0]]
        self._seen[id(value)] = len(self._seen), value  # kept, so that no other object gets its id meanwhile
        return self._composite(value, where)

    def _composite(self, value: Any, where: str) -> Any:
        match value:
            case np.ndarray():
                return ["array", *self._array(value)]
            case torch.Tensor():
                return ["tensor", *self._array(value.detach().cpu().numpy())]
            case np.random.Generator():
                return ["random", self.node(_deep(value.bit_generator.state), where)]
            case torch.Generator():
                return ["torch", *self._array(value.get_state().numpy())]
            case torch.optim.Optimizer() | torch.nn.Module():
                return ["state", self.node(dict(value.state_dict()), where)]
            case dict():
                pairs = value.items()
                return ["dict", [[self.node(k, where), self.node(v, f"{where}.{k}")] for k, v in pairs]]
            case list() | tuple():
                items = [self.node(item, f"{where}[{i}]") for i, item in enumerate(value)]
                name = _name(type(value)) if type(value) not in (list, tuple) else type(value).__name__
                return ["items", name, items]
            case functools.partial():
                return ["bound", self.node(value.func, where)]
            case types.MethodType():
                return ["bound", self.node(value.__self__, where)]
        return self._object(value, where)

    def _object(self, value: Any, where: str) -> Any:
        if not type(value).__module__.startswith(_HOUSE):
            raise TypeError(f"no way to save {where}, a {_name(type(value))}")
        if hasattr(value, "snapshot"):
            return ["own", self.node(value.snapshot(), where)]
        attributes = {key: self.node(item, f"{where}.{key}") for key, item in vars(value).items()}
        return ["object", _name(type(value)), attributes]

    def _array(self, array: np.ndarray) -> tuple[str, list[int], int]:
        name, offset = array.dtype.name, self._sizes[array.dtype.name]
        self.arrays[name].append(np.ascontiguousarray(array).ravel())
        self._sizes[name] += array.size
        return name, list(array.shape), offset


class _Reader:
    """Fills values from their nodes; gives the value that belongs in the place of the old one."""

    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self._arrays = arrays
        self._done: list[Any] = []

    def fill(self, old: Any, node: Any) -> Any:
        if not isinstance(node, list):
            return node
        kind, *rest = node
        if kind == "constant":
            return old
        if kind == "seen":
            return self._done[rest[0]]
        if kind in ("float", "scalar", "settings"):
            return getattr(self, f"_{kind}")(old, *rest)
        number = len(self._done)
        self._done.append(old)  # for what refers back to it from within
        self._done[number] = getattr(self, f"_{kind}")(old, *rest)
        return self._done[number]

    def _float(self, old: Any, text: str) -> float:
        return float(text)

    def _settings(self, old: Any, settings: Any) -> Any:
        return _from_settings(settings) if old is None else old

    def _scalar(self, old: Any, *place: Any) -> Any:
        return self._slice(*place)[()]

    def _array(self, old: Any, *place: Any) -> np.ndarray:
        """In place where it fits, since others may look at the same memory."""
        stored = self._slice(*place)
        if isinstance(old, np.ndarray) and (old.shape, old.dtype) == (stored.shape, stored.dtype):
            if old.flags.writeable:
                old[...] = stored
                return old
            if np.array_equal(old, stored):
                return old
        return stored.copy()

    @torch.no_grad()
    def _tensor(self, old: Any, *place: Any) -> torch.Tensor:
        stored = torch.from_numpy(self._slice(*place).copy())
        if isinstance(old, torch.Tensor) and (old.shape, old.dtype) == (stored.shape, stored.dtype):
            return old.copy_(stored)
        return stored

    def _random(self, old: Any, node: Any) -> Any:
        old.bit_generator.state = self.fill(None, node)
        return old

    def _torch(self, old: Any, *place: Any) -> Any:
        return old.set_state(torch.from_numpy(self._slice(*place).copy()))

    def _state(self, old: Any, node: Any) -> Any:
        old.load_state_dict(self.fill(None, node))
        return old

    def _dict(self, old: Any, pairs: list[Any]) -> Any:
        before = old if isinstance(old, dict) else {}
        new = {}
        for key_node, node in pairs:
            key = self.fill(None, key_node)
            new[key] = self.fill(before.get(key), node)
        if not isinstance(old, dict):
            return new
        old.clear()
        old.update(new)
        return old

    def _items(self, old: Any, name: str, nodes: list[Any]) -> Any:
        before = (
            list(old) if isinstance(old, list | tuple) and len(old) == len(nodes) else [None] * len(nodes)
        )
        new = [self.fill(item, node) for item, node in zip(before, nodes, strict=True)]
        if name == "list":
            if not isinstance(old, list):
                return new
            old[:] = new
            return old
        if name == "tuple":
            return tuple(new)
        return _class(name)(*new)

    def _bound(self, old: Any, node: Any) -> Any:
        self.fill(old.func if isinstance(old, functools.partial) else old.__self__, node)
        return old

    def _own(self, old: Any, node: Any) -> Any:
        old.restore(self.fill(None, node))
        return old

    def _object(self, old: Any, name: str, attributes: dict[str, Any]) -> Any:
        if _name(type(old)) != name:
            kind = _class(name)
            old = kind.__new__(kind)
        for key, node in attributes.items():
            value = self.fill(getattr(old, key, None), node)
            if getattr(old, key, None) is not value:
                setattr(old, key, value)
        return old

    def _slice(self, name: str, shape: list[int], offset: int) -> np.ndarray:
        return self._arrays[name][offset : offset + math.prod(shape)].reshape(shape)


def _is_constant(value: Any) -> bool:
    """Settings, tasks, clauses and code, which no run changes, and the registry."""
    if isinstance(value, _CONSTANT) or (isinstance(value, tuple) and value and all(map(_is_constant, value))):
        return True
    return is_dataclass(value) and bool(getattr(type(value), "__dataclass_params__").frozen)  # noqa: B009


def _settings(value: Any) -> Any:
    """A frozen dataclass of plain values, and of others such, as JSON; None if it has anything else in it.

    So an object that was made only after the start gets its settings back.
    """
    if not is_dataclass(value) or isinstance(value, type):
        return None
    found = {field.name: _settings_field(getattr(value, field.name)) for field in fields(value)}
    return None if None in found.values() else [_name(type(value)), found]


def _settings_field(value: Any) -> Any:
    if isinstance(value, tuple):
        items = [_settings_field(item) for item in value]
        return None if None in items else ["tuple", items]
    if isinstance(value, float):
        return ["float", repr(value)]
    return ["plain", value] if isinstance(value, _PLAIN) and not isinstance(value, Enum) else _settings(value)


def _from_settings(settings: Any) -> Any:
    kind, found = settings
    match kind:
        case "tuple":
            return tuple(map(_from_settings, found))
        case "float":
            return float(found)
        case "plain":
            return found
    return _class(kind)(**{name: _from_settings(value) for name, value in found.items()})


def _deep(value: Any) -> Any:
    """A copy without NumPy's scalars, which some generators have in their state."""
    if isinstance(value, dict):
        return {key: _deep(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _class(name: str) -> Any:
    """A class of this project that is loaded already."""
    module, _, kind = name.rpartition(".")
    if not module.startswith(_HOUSE):
        raise TypeError(f"{name} isn't of this project")
    return getattr(sys.modules[module], kind)
