"""A run's own figure: its score, and whom it followed."""

import pytest

from paddlectl.errors import IntegrityError, NotFoundError
from paddlectl.registry.store import Registry
from paddlectl.report.run_panels import run_panels
from samples import BLOCKED_DOOR, TARGET, add_source, program, reuse, weight_rows


@pytest.fixture
def registry(tmp_path):
    made = Registry.open(tmp_path / "registry")
    for task in ("BlockedDoor", "GapBall"):
        add_source(made, task, program("BlockedDoor", BLOCKED_DOOR))
    return made


def add(registry, scores, sources=("policy-1", "policy-2"), finished=True, **tables):
    """A run with an episode every ten frames."""
    run = registry.add_run(
        kind="transfer", method="paddle", task=TARGET, scenario="A", sources=sources, seed=3, settings={},
        versions={},
    )  # fmt: skip
    rows = [
        {"order": n, "started": 10 * n, "frames": 10 * n + 10, "score": score}
        for n, score in enumerate(scores)
    ]
    registry.files.append_rows(run.id, "episodes", rows)
    for name, table in tables.items():
        registry.files.append_rows(run.id, name, table)
    if finished:
        more = {"frames": 10 * len(rows), "episodes": len(rows), "seconds": 1.0, "results": {}}
        registry.finish_run(run.id, status="finished", **more)
    return registry.run(run.id)


def row(source, frames, chosen):
    return {
        "frames": frames, "context": ["x()"], "source": source, "terms": {}, "weight": 0.5, "chosen": chosen,
        "reached": None,
    }  # fmt: skip


@pytest.mark.parametrize("finished", [True, False])
def test_the_score_over_frames_and_over_episodes(registry, finished):
    run = add(registry, [0.0] * 100 + [1.0] * 100, finished=finished)
    (panel,) = run_panels(registry, run, "frames")
    assert (panel.title, panel.note) == (f"run-3: paddle on {TARGET}", "seed 3, latest 100 episodes")
    (score,) = panel.series
    assert score.label == "paddle" and score.x == tuple(range(0, 2000, 20))
    assert (score.mid[49], score.mid[-1]) == (0.0, 0.99)
    (panel,) = run_panels(registry, run, "episodes")
    assert (panel.series[0].x, panel.series[0].mid) == ((50.0, 100.0, 150.0, 200.0), (0.0, 0.0, 0.5, 1.0))


def test_too_few_episodes_are_no_curve(registry):
    for scores, axis in (([], "frames"), ([], "episodes"), ([1.0] * 49, "episodes")):
        with pytest.raises(NotFoundError, match=f"^{len(scores)} episodes of run-[0-9]+ have ended, too few"):
            run_panels(registry, add(registry, scores), axis)
    assert run_panels(registry, add(registry, [1.0]), "frames")


def test_episodes_after_one_that_goes_on_are_none_yet(registry):
    run = add(registry, [], finished=False)
    later = [{"order": n, "started": 0, "frames": 9, "score": 1.0} for n in range(1, 90)]
    registry.files.append_rows(run.id, "episodes", later)
    for axis in ("frames", "episodes"):
        with pytest.raises(NotFoundError, match=r"^0 episodes of"):
            run_panels(registry, run, axis)


def test_the_share_of_each_in_each_period(registry):
    rows = [
        row("target", 500, 0), row("policy-1", 500, 30), row("policy-2", 500, 10), row("policy-1", 500, 10),
        row("target", 1000, 75), row("policy-1", 1000, 25), row("policy-2", 1000, 0), row("target", 1200, 0),
    ]  # fmt: skip
    _, panel = run_panels(registry, add(registry, [1.0] * 100, reuse=rows), "episodes")
    assert {one.label: one.mid for one in panel.series} == {
        "target": (0.0, 0.75),
        "BlockedDoor": (0.8, 0.25),
        "GapBall": (0.2, 0.0),
    }
    assert {one.x for one in panel.series} == {(500.0, 1000.0)}, "nobody chose in the last"


def test_phases_are_periods_too(registry):
    rows = [{**row, "frames": {"early": 300, "late": 1000}[row["phase"]]} for row in weight_rows()]
    _, panel = run_panels(registry, add(registry, [1.0] * 100, weights=rows), "frames")
    shares = {one.label: one.mid for one in panel.series}
    assert shares["BlockedDoor"] == (round(384 / 450, 6), 0.3)
    assert shares["GapBall"] == (round(62 / 450, 6), 0.0)
    assert all(one.x == (300.0, 1000.0) for one in panel.series)
    old = [{name: value for name, value in row.items() if name != "frames"} for row in weight_rows()]
    assert len(run_panels(registry, add(registry, [1.0] * 100, weights=old), "frames")) == 1


def test_a_source_of_an_imported_run_is_told_by_its_id_elsewhere(registry):
    run = add(registry, [1.0] * 100, reuse=[row("policy-9", 1000, 5), row("target", 1000, 5)])
    reuse(registry, run.id, ["elsewhere:policy-9"])
    _, panel = run_panels(registry, registry.run(run.id), "frames")
    assert [one.label for one in panel.series] == ["elsewhere:policy-9", "target"]


def test_rows_that_no_run_writes_are_refused(registry):
    for table, rows in (
        ("reuse", [row("policy-7", 1, 1)]),
        ("reuse", [row("target", -1, 1)]),
        ("weights", [weight_rows()[0] | {"frames": "many"}]),
        ("episodes", [{"order": 0}]),
    ):
        run = add(registry, [1.0] * 100, finished=False, **({table: rows} if table != "episodes" else {}))
        if table == "episodes":
            registry.files.append_rows(run.id, table, rows)
        with pytest.raises(IntegrityError):
            run_panels(registry, run, "frames")
