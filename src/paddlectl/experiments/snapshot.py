"""The state of any objects as JSON and flat arrays, and back into objects made alike.

What is kept isn't listed anywhere: every attribute of every object that is reached is taken, constants too,
and a kind of value that isn't known is an error. So nothing can be forgotten when a class gets a new
attribute. Going back, objects are made as at the start of a run and then overwritten; what was restored is
captured once more and must be what was stored, bit for bit.

Classes of this package and of the plug-ins in use are known by their attributes, if they are plain: such as
make, set and delete their objects as any class does. Of other projects' classes only named tuples, enums and
frozen dataclasses are. All others, and an object whose state isn't in its attributes (a simulator's), offer
`snapshot()`, which gives any value that is known here, and `restore(value)`.

Nothing is imported for what was saved, and no function called by a name in it: an object that isn't there yet
is made of a class that the run itself has loaded.
"""

import functools
import gc
import hashlib
import inspect
import json
import math
import sys
import types
from collections import defaultdict
from collections.abc import Collection
from dataclasses import is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
import torch

from paddlectl import plugins
from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.registry.store import Registry

_PLAIN = (type(None), bool, int, str)
_CODE = (types.FunctionType, types.BuiltinFunctionType, type)
_CONTAINERS = (dict, list, tuple, set, frozenset, bytearray, np.ndarray, torch.Tensor, str, bytes, int, float)
_TENSORS = (torch.Tensor, torch.nn.Parameter)
_OF_MODULES = vars(torch.nn.Module()).keys() - {"training"}


def capture(roots: dict[str, Any]) -> tuple[Any, bytes]:
    """All state that can be reached from these objects: JSON, and a safetensors file for its arrays.

    Raises:
        PaddlectlError: If there is a value that can't be captured; it tells where.
    """
    writer = _Writer()
    tree = writer.node(roots, "")
    flat = {name: np.concatenate(parts) for name, parts in writer.arrays.items()}
    return tree, safetensors.numpy.save(flat)


def digest(roots: dict[str, Any]) -> str:
    """The SHA-256 of state but for its arrays: of all settings and shapes, and of who is there.

    Raises:
        PaddlectlError: As `capture`.
    """
    return hashlib.sha256(json.dumps(_Writer().node(roots, "")).encode()).hexdigest()


def restore(roots: dict[str, Any], tree: Any, arrays: bytes) -> None:
    """Puts captured state into objects that were made as those were at first.

    Raises:
        IntegrityError: If it isn't theirs, as when another version of the program captured it.
    """
    try:
        _Reader(safetensors.numpy.load(arrays)).fill(roots, tree)
    except (*_MISFITS, safetensors.SafetensorError) as error:
        raise IntegrityError(f"what was saved doesn't fit this version: {error}"[:300], HINT) from error
    if capture(roots) != (tree, arrays):
        raise IntegrityError("what was saved can't be restored exactly by this version", HINT)


_MISFITS = (AttributeError, LookupError, RuntimeError, TypeError, ValueError)
HINT = "go on with the version of paddlectl that the run began with"


class _Writer:
    """Turns values into nodes: plain JSON values as they are, all others a list that begins with a kind."""

    def __init__(self) -> None:
        self.arrays: dict[str, list[np.ndarray]] = defaultdict(list)
        self._sizes: dict[str, int] = defaultdict(int)
        self._seen: dict[int, tuple[int, Any]] = {}
        self._in_constant = False

    def node(self, value: Any, where: str) -> Any:
        if type(value) in _PLAIN:
            return value
        if type(value) is float:
            return value if math.isfinite(value) else ["float", repr(value)]
        if type(value) is bytes:
            return ["bytes", value.hex()]
        if isinstance(value, np.generic):
            return ["scalar", *self._array(np.asarray(value), value, where)]
        if isinstance(value, Enum):
            return ["enum", _name(type(value)), self.node(value.value, where)]
        if (fixed := _fixed(value)) is not None:
            return ["fixed", fixed]
        if self._in_constant:
            return self._composite(value, where)
        if _is_constant(value):  # by value alone: which equal ones are one object depends on the interpreter
            return ["constant", self._constant(value, where)]
        if id(value) in self._seen:
            return ["seen", self._seen[id(value)][0]]
        self._seen[id(value)] = len(self._seen), value  # kept, so that no other object gets its id meanwhile
        return self._composite(value, where)

    def _constant(self, value: Any, where: str) -> Any:
        self._in_constant = True
        try:
            return self._composite(value, where)
        finally:
            self._in_constant = False

    def _composite(self, value: Any, where: str) -> Any:
        kind = type(value)
        if _offers(kind):
            return [
                "own",
                _name(kind),
                sorted(_variables(value)),
                self.node(value.snapshot(), f"{where}.snapshot()"),
            ]
        if (parts := _parts(value)) is not None:
            return ["bound", _called(value), [self.node(part, where) for part in parts]]
        match value:
            case np.ndarray() if kind is np.ndarray:
                return ["array", *self._array(value, value, where)]
            case torch.Tensor() if kind in _TENSORS:
                return ["tensor", value.requires_grad, *self._tensor(value, where)]
            case np.random.Generator():
                return ["random", self.node(_deep(value.bit_generator.state), where)]
            case torch.Generator():
                return ["torch", *self._array(value.get_state().numpy(), value, where)]
            case torch.optim.Optimizer():
                return ["state", self.node(value.state_dict(), where)]
            case torch.nn.Module():
                return ["module", self.node(dict(value.state_dict()), where), self._module(value, where)]
            case dict() if kind is dict:
                return [
                    "dict",
                    [[self._key(k, where), self.node(v, f"{where}.{k}")] for k, v in value.items()],
                ]
            case types.MappingProxyType():
                return ["view", self.node(_viewed(value), where)]
            case frozenset() if kind is frozenset:
                return ["set", self._set(value, where)]
            case list() | tuple() if kind in (list, tuple) or _is_named_tuple(kind):
                name = kind.__name__ if kind in (list, tuple) else _name(kind)
                return ["items", name, [self.node(item, f"{where}[{i}]") for i, item in enumerate(value)]]
        return self._object(value, where)

    def _object(self, value: Any, where: str) -> Any:
        kind = type(value)
        if not _is_ours(kind) or isinstance(value, _CONTAINERS):
            raise _refused(value, where)
        attributes = {key: self.node(item, f"{where}.{key}") for key, item in _attributes(value).items()}
        return ["object", _name(kind), attributes]

    def _module(self, module: torch.nn.Module, where: str) -> Any:
        """What a network's `state_dict` hasn't."""
        return {
            path: {key: self.node(item, f"{where}.{path}.{key}") for key, item in attributes.items()}
            for path, attributes in _beside(module).items()
        }

    def _key(self, key: Any, where: str) -> Any:
        """A key of a dict, which is found again by its value."""
        if not _is_constant(key):
            raise _refused(key, f"{where}, a key")
        return self.node(key, where)

    def _set(self, value: frozenset[Any], where: str) -> list[Any]:
        for item in value:
            if not _is_constant(item):
                raise _refused(item, f"{where}, an item")
        return [self.node(item, where) for item in sorted(value, key=_order)]

    def _tensor(self, tensor: torch.Tensor, where: str) -> tuple[str, list[int], int]:
        try:
            array = tensor.detach().cpu().numpy()
        except (RuntimeError, TypeError):
            raise _refused(tensor, where, f"{tensor.dtype} ") from None
        return self._array(array, tensor, where)

    def _array(self, array: np.ndarray, owner: Any, where: str) -> tuple[str, list[int], int]:
        name, offset = array.dtype.name, self._sizes[array.dtype.name]
        if name not in _DTYPES:
            raise _refused(owner, where, f"{name} ")
        self.arrays[name].append(np.ascontiguousarray(array).ravel())
        self._sizes[name] += array.size
        return name, list(array.shape), offset


class _Reader:
    """Fills values from their nodes; gives the value that belongs in the place of the old one.

    That is the old one wherever it can be, for others may refer to it; but only in one place of those that
    shared it at the start and don't any more.
    """

    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self._arrays = arrays
        self._done: list[Any] = []
        self._used: dict[int, Any] = {}

    def fill(self, old: Any, node: Any) -> Any:
        if not isinstance(node, list):
            return _kept(old, node)
        kind, *rest = node
        if kind == "seen":
            return self._done[rest[0]]
        if kind in ("bytes", "constant", "enum", "fixed", "float", "scalar"):
            return getattr(self, f"_{kind}")(old, *rest)
        if id(old) in self._used:
            old = None
        self._used[id(old)] = old
        number = len(self._done)
        self._done.append(old)  # for what refers back to it from within
        self._done[number] = getattr(self, f"_{kind}")(old, *rest)
        return self._done[number]

    def _bytes(self, old: Any, text: str) -> Any:
        return _kept(old, bytes.fromhex(text))

    def _constant(self, old: Any, node: Any) -> Any:
        return _Reader(self._arrays).fill(old, node)

    def _enum(self, old: Any, name: str, node: Any) -> Any:
        kind = _kind(old, name)
        if not issubclass(kind, Enum):
            raise TypeError(f"{name} is no enum")
        return kind(self.fill(None, node))

    def _fixed(self, old: Any, _name: str) -> Any:
        return old

    def _float(self, old: Any, text: str) -> Any:
        return _kept(old, float(text))

    def _scalar(self, old: Any, *place: Any) -> Any:
        return _kept(old, self._slice(*place)[()])

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
    def _tensor(self, old: Any, learns: bool, *place: Any) -> torch.Tensor:
        stored = torch.from_numpy(self._slice(*place).copy())
        if isinstance(old, torch.Tensor) and (old.shape, old.dtype) == (stored.shape, stored.dtype):
            return old.copy_(stored).requires_grad_(learns)
        return stored.requires_grad_(learns)

    def _random(self, old: Any, node: Any) -> Any:
        rng = np.random.default_rng() if old is None else old
        rng.bit_generator.state = self.fill(None, node)
        return rng

    def _torch(self, old: Any, *place: Any) -> Any:
        generator = torch.Generator() if old is None else old
        return generator.set_state(torch.from_numpy(self._slice(*place).copy()))

    def _state(self, old: Any, node: Any) -> Any:
        old.load_state_dict(self.fill(None, node))
        return old

    def _module(self, old: Any, state: Any, beside: dict[str, dict[str, Any]]) -> Any:
        old.load_state_dict(self.fill(None, state))
        for path, nodes in beside.items():
            part = old.get_submodule(path)
            _require_stored(type(part), nodes)
            self._set_attributes(part, nodes)
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

    def _view(self, old: Any, node: Any) -> Any:
        before = _viewed(old) if isinstance(old, types.MappingProxyType) else None
        new = self.fill(before, node)
        return old if new is before else types.MappingProxyType(new)

    def _set(self, old: Any, nodes: list[Any]) -> Any:
        new = frozenset(self.fill(None, node) for node in nodes)
        return old if type(old) is frozenset and old == new else new

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
        kind = tuple if name == "tuple" else _kind(old, name)
        if kind is not tuple and not _is_named_tuple(kind):
            raise TypeError(f"{name} is no named tuple")
        same = type(old) is kind and all(a is b for a, b in zip(new, before, strict=True))
        return old if same and len(old) == len(new) else tuple.__new__(kind, new)

    def _bound(self, old: Any, name: str, nodes: list[Any]) -> Any:
        parts = _parts(old)
        if parts is None or _called(old) != name:
            raise TypeError(f"{name} isn't there")
        new = [self.fill(part, node) for part, node in zip(parts, nodes, strict=True)]
        if isinstance(old, types.FunctionType):
            for cell, value in zip(old.__closure__ or (), new, strict=True):
                cell.cell_contents = value
        return old

    def _own(self, old: Any, name: str, names: list[str], node: Any) -> Any:
        kind = _kind(old, name)
        if not _offers(kind):
            raise TypeError(f"{name} has no snapshot() and restore()")
        state = self.fill(None, node)
        if type(old) is kind:
            old.restore(state)
            return old
        new = kind.__new__(kind)
        new.restore(state)
        if sorted(_variables(new)) != names:
            raise TypeError(f"restore() of a new {name} doesn't set all that it has")
        return new

    def _object(self, old: Any, name: str, nodes: dict[str, Any]) -> Any:
        kind = _kind(old, name)
        if not _is_ours(kind):
            raise TypeError(f"{name} isn't of this project")
        _require_stored(kind, nodes)
        if not _is_frozen(kind):
            return self._set_attributes(old if type(old) is kind else kind.__new__(kind), nodes)
        new = {key: self.fill(getattr(old, key, None), node) for key, node in nodes.items()}
        if type(old) is kind and all(getattr(old, key, _MISSING) is value for key, value in new.items()):
            return old
        made = object.__new__(kind)
        for key, value in new.items():
            object.__setattr__(made, key, value)
        return made

    def _set_attributes(self, owner: Any, nodes: dict[str, Any]) -> Any:
        for key, node in nodes.items():
            old = getattr(owner, key, _MISSING)
            value = self.fill(None if old is _MISSING else old, node)
            if old is not value:
                setattr(owner, key, value)
        return owner

    def _slice(self, name: str, shape: list[int], offset: int) -> np.ndarray:
        return self._arrays[name][offset : offset + math.prod(shape)].reshape(shape)


_MISSING = object()
_DTYPES = {  # that safetensors takes
    "bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "float16", "float32", "float64", "complex64",
}  # fmt: skip


def _fixed(value: Any) -> str | None:
    """What it is called, if it is code, a kind of number, a path or the registry, which no run changes."""
    if isinstance(value, Registry):
        return "registry"
    if isinstance(value, types.ModuleType):
        return value.__name__
    if isinstance(value, _CODE) and _parts(value) is None:
        return _called(value)
    if isinstance(value, np.dtype | torch.dtype | torch.device | PurePath):
        return str(value)
    return None


def _parts(value: Any) -> list[Any] | None:
    """What a function has to work with besides its code; None if that is nothing, or it is no function."""
    match value:
        case functools.partial():
            return [value.func, value.args, value.keywords]
        case types.MethodType():
            return [value.__self__]
        case types.BuiltinFunctionType() if not isinstance(value.__self__, types.ModuleType | None):
            return [value.__self__]
        case types.FunctionType() if value.__closure__ and not _is_of_module(value):
            return [cell.cell_contents for cell in value.__closure__]
    return None


def _is_of_module(function: types.FunctionType) -> bool:
    """Whether a module holds it, decorated or not: it is code then, which no run changes."""
    found: Any = sys.modules.get(function.__module__)
    for name in function.__qualname__.split("."):
        found = getattr(found, name, None)
    return found is function


def _is_constant(value: Any) -> bool:
    """Whether neither it nor anything in it can change."""
    kind: Any = type(value)
    if _offers(kind):
        return False
    if kind is tuple or kind is frozenset or _is_named_tuple(kind):
        return all(map(_is_constant, value))
    if _is_frozen(kind):
        return kind.__hash__ is not object.__hash__ and all(map(_is_constant, _attributes(value).values()))
    return (
        kind in (*_PLAIN, float, bytes) or isinstance(value, np.generic | Enum) or _fixed(value) is not None
    )


def _attributes(value: Any) -> dict[str, Any]:
    """Of an object; without what a frozen one works out from its constants when it is asked for."""
    kind = type(value)
    found = _variables(value)
    if not _is_frozen(kind):
        return found
    derived = {key for key in found if isinstance(getattr(kind, key, None), functools.cached_property)}
    return {key: item for key, item in found.items() if key not in derived or not _is_constant(item)}


def _variables(value: Any) -> dict[str, Any]:
    kind: Any = type(value)
    found = {name: getattr(value, name) for name in _slots(kind) if hasattr(value, name)}
    return found | getattr(value, "__dict__", {})


@functools.cache
def _slots(kind: Any) -> tuple[str, ...]:
    members = [member for each in kind.__mro__ for member in vars(each).items()]
    return tuple(name for name, member in members if isinstance(member, types.MemberDescriptorType))


def _beside(module: torch.nn.Module) -> dict[str, dict[str, Any]]:
    """The attributes of a network's parts that its `state_dict` hasn't, by the path of the part."""
    found = {}
    for path, part in module.named_modules():
        theirs = type(part).__module__.startswith("torch.")
        attributes = {"training": part.training} if theirs else vars(part)
        buffers = {name: part._buffers[name] for name in sorted(part._non_persistent_buffers_set)}
        found[path] = {k: v for k, v in attributes.items() if k not in _OF_MODULES} | buffers
    return found


def _viewed(view: Any) -> Any:
    """The dict that a mapping proxy shows, which has no other name."""
    return gc.get_referents(view)[0]


def _kept(old: Any, new: Any) -> Any:
    return old if type(old) is type(new) and repr(old) == repr(new) else new


def _offers(kind: type) -> bool:
    return callable(getattr(kind, "snapshot", None)) and callable(getattr(kind, "restore", None))


def _is_frozen(kind: type) -> bool:
    return is_dataclass(kind) and bool(getattr(kind, "__dataclass_params__").frozen)  # noqa: B009


def _is_named_tuple(kind: type) -> bool:
    return issubclass(kind, tuple) and hasattr(kind, "_fields")


def _is_ours(kind: type) -> bool:
    """Whether it is known by its attributes."""
    return _is_frozen(kind) or (kind.__module__.partition(".")[0] in plugins.packages and _is_plain(kind))


def _is_plain(kind: type) -> bool:
    """Whether no code of its own runs when an object is made, set and deleted."""
    usual = all(getattr(kind, name) is getattr(object, name) for name in ("__new__", "__setattr__"))
    return usual and not hasattr(kind, "__del__")


def _require_stored(kind: type, names: Collection[str]) -> None:
    """Refuses names that the class answers by code, such as a property.

    Raises:
        TypeError: If there is one.
    """
    for name in names:
        found = inspect.getattr_static(kind, name, None)
        if hasattr(type(found), "__set__") and not isinstance(found, types.MemberDescriptorType):
            raise TypeError(f"{name} of {_name(kind)} isn't stored")


def _order(value: Any) -> str:
    """By which the items of a set are sorted, for their own order differs between processes."""
    return json.dumps(_Writer().node(value, ""))


def _deep(value: Any) -> Any:
    """A copy without NumPy's scalars, which some generators have in their state."""
    if isinstance(value, dict):
        return {key: _deep(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def _refused(value: Any, where: str, dtype: str = "") -> PaddlectlError:
    kind = type(value)
    return PaddlectlError(
        f"{where.lstrip('.')}: a {dtype}{kind.__qualname__} of module {kind.__module__} can't be captured: "
        "give it snapshot() and restore()"
    )


def _called(value: Any) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)}"


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _kind(old: Any, name: str) -> Any:
    """The class of that name: the old object's, or another that is loaded already.

    It is looked up where it was defined, without calling anything on the way.
    """
    if _name(type(old)) == name:
        return type(old)
    inner: list[str] = []
    module = name
    while module and module not in sys.modules:
        module, _, last = module.rpartition(".")
        inner.insert(0, last)
    found: Any = sys.modules.get(module)
    for last in inner:
        found = vars(found)[last] if isinstance(found, types.ModuleType | type) else None
    if not isinstance(found, type) or _name(found) != name:
        raise TypeError(f"no class {name} is loaded")
    return found
