"""No training draws a layout that an evaluation draws: by value, on every task."""

import gymnasium
import numpy as np
import pytest

from paddlectl.tasks import registration, suite
from paddlectl.tasks.maze2d.layouts import draw_starts, starts_of
from paddlectl.tasks.minigrid.grid import ABSENT, WIDTH, Thing
from paddlectl.tasks.minigrid.layouts import SPECS, Layouts, draw_layouts
from paddlectl.tasks.registration import environment_id
from paddlectl.tasks.split import ONE_IN, belongs


def values(task: str, split: str, seed: int, episodes: int) -> set[bytes]:
    """What distinguishes the layouts that an environment of the task draws, its facing left out."""
    environment = suite.load(task).make(50, seed, 1, split)
    seen: set[bytes] = set()
    for _ in range(episodes // 50):
        state = environment.state if task in SPECS else environment.masses
        parts = (state.agent, state.where) if task in SPECS else (state.position,)
        seen |= {row.tobytes() for row in np.column_stack(parts)}
        environment.reset()
    return seen


@pytest.mark.parametrize("task", registration.ENTRY_POINTS)
def test_no_training_draws_an_evaluation_layout(task: str) -> None:
    evaluated = set().union(*(values(task, "evaluation", seed, 1000) for seed in (12345, 7)))
    trained = set().union(*(values(task, "training", seed, 5000) for seed in (0, 7, 12345)))
    assert evaluated.isdisjoint(trained)
    assert len(evaluated) > 400, "enough of them to evaluate on"


@pytest.mark.parametrize("split", ["training", "evaluation"])
@pytest.mark.parametrize("task", registration.ENTRY_POINTS)
def test_all_that_is_drawn_is_of_the_split_by_an_engine_and_by_gymnasiums_environment(
    task: str, split: str
) -> None:
    environment = suite.load(task).make(40, 3, 1, split)
    room = "minigrid" if task in SPECS else "maze2d"
    single = gymnasium.make(f"paddlectl.tasks.{room}.env:{environment_id(task)}", split=split).unwrapped
    for turn in range(40):
        environment.reset(np.arange(40) % 3 == turn % 3)
        single.reset(seed=turn)
        if task in SPECS:
            state = environment.state
            assert Layouts(state.agent, state.facing, state.where).of(split).all()
            cells = [_cell(single.agent_pos), *(_cell(single._objects[t].cur_pos) for t in list(Thing)[:-1])]
            assert belongs(np.array([[*cells, ABSENT]]), split).all()
        else:
            assert starts_of(environment.masses.position, split).all()
            assert starts_of(single.position[None], split).all()


def _cell(position: tuple[int, int] | None) -> int:
    return ABSENT if position is None else position[1] * WIDTH + position[0]


@pytest.mark.parametrize("task", SPECS)
def test_a_facing_has_no_part_in_it_and_an_eighth_is_for_evaluation(task: str) -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_layouts(SPECS[task], rng, n, split) for n, split in ((70, "training"), (10, "evaluation"))]
    for layouts, split in zip(drawn, ("training", "evaluation"), strict=True):
        turned = Layouts(layouts.agent, (layouts.facing + 1) % 4, layouts.where)
        assert turned.of(split).all()
    many = np.random.default_rng(1).integers(121, size=(80_000, 10))
    assert belongs(many, "evaluation").mean() == pytest.approx(1 / ONE_IN, abs=0.005)
    assert (belongs(many, "evaluation") != belongs(many, "training")).all()


def test_starts_of_one_square_are_of_one_split() -> None:
    rng = np.random.default_rng(0)
    evaluated, trained = (draw_starts(rng, 2000, split) for split in ("evaluation", "training"))
    assert starts_of(evaluated, "evaluation").all()
    assert not starts_of(trained, "evaluation").any()
    squares = [{(int(x), int(y)) for x, y in (starts + 10) // (0.5 / 8)} for starts in (evaluated, trained)]
    assert squares[0].isdisjoint(squares[1])
    assert 2 <= len(squares[0]) <= 16
