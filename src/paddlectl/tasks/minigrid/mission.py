"""The space of a task's mission. MiniGrid's own can't be pickled, nor shared between processes."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import create_shared_memory, read_from_shared_memory, write_to_shared_memory


class Mission(gymnasium.Space[str]):
    """The one text that a task's observations have."""

    def __init__(self, text: str) -> None:
        super().__init__(shape=(), dtype=np.dtype(f"<U{len(text)}"))
        self.text = text

    @property
    def is_np_flattenable(self) -> bool:
        return False

    def sample(self, mask: Any = None, probability: Any = None) -> str:
        return self.text

    def contains(self, x: Any) -> bool:
        return isinstance(x, str) and x == self.text

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mission) and self.text == other.text

    def __repr__(self) -> str:
        return f"Mission({self.text!r})"


# As it never changes, a vector environment's processes needn't share it.
@create_shared_memory.register
def _create(space: Mission, n: int = 1, ctx: Any = None) -> tuple[()]:
    return ()


@read_from_shared_memory.register
def _read(space: Mission, shared_memory: tuple[()], n: int = 1) -> tuple[str, ...]:
    return (space.text,) * n


@write_to_shared_memory.register
def _write(space: Mission, index: int, value: str, shared_memory: tuple[()]) -> None:
    pass
