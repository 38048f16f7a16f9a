"""Transfer between reinforcement-learning tasks by logic and performance similarity, from Python.

    import gymnasium, paddlectl

    policy = paddlectl.load("BoxDoor")
    env = gymnasium.make("paddlectl.tasks.registration:paddle/BoxDoor-v0")
    env.reset(seed=0)
    env.step(policy.act(env))

What is needed is imported when a name is first used. Mistakes are told as `PaddlectlError`s.
"""

from importlib import import_module

TYPE_CHECKING = False  # typing's own would have to be loaded before ^C is handled

if TYPE_CHECKING:
    from paddlectl.api import Policy, Result, Runs, add_tasks, load, runs, train, transfer
    from paddlectl.errors import (
        IntegrityError,
        InvalidFileError,
        NotFoundError,
        PaddlectlError,
        RegistryBusyError,
        SchemaVersionError,
        UsageError,
    )

    __version__: str

__all__ = [
    "IntegrityError",
    "InvalidFileError",
    "NotFoundError",
    "PaddlectlError",
    "Policy",
    "RegistryBusyError",
    "Result",
    "Runs",
    "SchemaVersionError",
    "UsageError",
    "__version__",
    "add_tasks",
    "load",
    "runs",
    "train",
    "transfer",
]

# The package `transfer` bears the name of a function. A package is set as an attribute when it is imported
# first, which is now and not once the function is there.
import_module("paddlectl.transfer")
del globals()["transfer"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    home = import_module("paddlectl.errors" if name.endswith("Error") else "paddlectl.api")
    return globals().setdefault(name, getattr(home, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
