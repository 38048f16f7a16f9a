"""What every method of the catalogue promises to whoever runs it."""

from collections.abc import Callable, Iterator

import pytest

from contract import CHECKS, TASKS
from paddlectl.errors import UsageError
from paddlectl.methods import finetune
from paddlectl.methods.base import method_of
from paddlectl.methods.catalogue import METHODS, entry_of, require_actions, usable
from paddlectl.tasks.suite import load
from trials.runs import short_episodes

EACH = [(name, kind) for name, entry in usable().items() for kind in sorted(entry.actions)]


@pytest.fixture(autouse=True, scope="module")
def short() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch, short_episodes():
        patch.setattr(finetune, "TRIALS", 2)
        yield


@pytest.mark.parametrize(("name", "actions"), EACH)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_what_is_promised(check: Callable[[str, str], None], name: str, actions: str) -> None:
    check(name, actions)


def test_a_method_is_called_as_it_is_listed():
    assert {name: method_of(name).name for name in METHODS} == {name: name for name in METHODS}
    assert all(METHODS.keys() >= set(entry.teaches) for entry in METHODS.values())
    assert all(entry.summary and len(entry.summary) < 100 for entry in METHODS.values())


@pytest.mark.parametrize("typed, hint", [("hdmm", "hdm"), ("", ""), ("TD3", "td3")])
def test_an_unknown_method_is_told_with_those_that_there_are(typed, hint):
    with pytest.raises(UsageError) as told:
        method_of(typed)
    assert "\n" not in told.value.message
    assert told.value.hint.endswith(", ".join(METHODS))
    assert hint in told.value.hint


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("actions", ["discrete", "continuous"])
def test_a_task_whose_actions_it_cant_choose_is_refused(name, actions):
    task = load(TASKS[actions][0])
    if actions in entry_of(name).actions:
        require_actions(name, task)
        return
    with pytest.raises(UsageError, match=f"{name} chooses .*; those of {task.name} are {actions}") as told:
        require_actions(name, task)
    assert "\n" not in told.value.message
    assert "hdm" in told.value.hint
