"""What a comparison says of results made by hand, and what it refuses to say."""

import dataclasses
import json
import math

import pytest

from paddlectl.errors import InvalidFileError, NotFoundError, UsageError
from paddlectl.report.compared import compared_parts
from paddlectl.report.output import print_text
from paddlectl.report.panels import panels_of
from paddlectl.studies.comparison import comparison_document
from paddlectl.studies.grouped import FIGURES
from paddlectl.studies.results import read_results, write_results
from studies.made import SIX, moved, result, results

AREA, JUMP = "area_under_curve", "jump_start"


def only(rows, **wanted):
    """The row with these fields."""
    (found,) = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    return found


@pytest.fixture(scope="module")
def document():
    """Ahead in A, level in B, behind in C."""
    return comparison_document(
        results(
            {
                ("A", "cup"): moved(-0.3), ("A", "paddle"): SIX,
                ("B", "cup"): SIX[::-1], ("B", "paddle"): SIX,
                ("C", "cup"): moved(0.15), ("C", "paddle"): SIX,
            }
        )
    )  # fmt: skip


def test_a_cell_by_hand(document) -> None:
    cell = only(document["cells"], scenario="A", label="paddle")
    assert (cell["n"], cell["seeds"], cell["source_frames"]) == (6, [0, 1, 2, 3, 4, 5], 60_000)
    for kind in ("mean", "iqm", "median"):
        estimate = cell[AREA][kind]
        assert estimate["value"] == pytest.approx(0.75)
        assert 0.70 <= estimate["low"] < 0.75 < estimate["high"] <= 0.80


def test_words_go_as_far_as_the_intervals(document) -> None:
    assert document["of"] == "paddle"
    (told,) = document["verdicts"][AREA]
    assert told.startswith("paddle is ahead of cup in A; level in B; behind in C; over all ")
    assert told.endswith(" (area under the curve, 6 seeds)")
    assert document["notes"] == []


def test_against_by_hand(document) -> None:
    ahead = only(document["against"], scenario="A")
    assert (ahead["label"], ahead["n"], ahead["pairs"]) == ("cup", [6, 6], 6)
    assert ahead[AREA]["probability_of_improvement"] == {"value": 1.0, "low": 1.0, "high": 1.0}
    assert ahead[AREA]["difference"]["value"] == pytest.approx(0.3)
    assert ahead[AREA]["difference"]["low"] == pytest.approx(0.3)  # the same for each seed
    level = only(document["against"], scenario="B")[AREA]
    assert level["probability_of_improvement"]["value"] == 0.5
    assert level["difference"]["low"] < 0 < level["difference"]["high"]


def test_ties_are_ties_and_only_who_is_apart_from_all_is_the_best(document) -> None:
    best = {row["scenario"]: row["labels"] for row in document["best"] if row["figure"] == AREA}
    assert (best["A"], best["B"], best["C"]) == (["paddle"], ["cup", "paddle"], ["cup"])


def test_over_all_the_scenarios_are_strata(document) -> None:
    assert document["overall"]["scenarios"] == ["A", "B", "C"]
    row = only(document["overall"]["labels"], label="paddle")
    assert row["n"] == 18
    assert row[AREA]["mean"]["value"] == pytest.approx(0.75)
    assert row[AREA]["optimality_gap"]["value"] == pytest.approx(0.25)
    profile = only(document["profiles"], label="paddle", figure=AREA)
    assert profile["thresholds"][0] == 0.0 and profile["thresholds"][-1] == 1.0
    assert profile["value"][0] == 1.0 and profile["value"][-1] == 0.0


def test_the_same_results_give_the_same_numbers(document) -> None:
    scores = {("A", "cup"): moved(0.01), ("A", "paddle"): SIX}
    first, again = (comparison_document(results(scores)) for _ in range(2))
    assert json.dumps(first) == json.dumps(again)


def test_few_seeds_say_nothing_however_far_they_are_apart() -> None:
    for seeds, few in ((1, "1 seed"), (2, "2 seeds"), (3, "3 seeds")):
        told = comparison_document(results({("A", "paddle"): SIX[:seeds], ("A", "cup"): moved(-0.5)[:seeds]}))
        assert told["verdicts"][AREA] == [
            f"too few seeds to tell paddle from cup in A (area under the curve, {few})"
        ]
        assert set(only(told["best"], figure=AREA, scenario="A")["labels"]) == {"paddle", "cup"}
        assert told["notes"][0].startswith("fewer than 5 seeds")
        assert f"paddle in A ({seeds})" in told["notes"][0]
    one = comparison_document([result("A", "paddle", 0, 0.7)])
    assert one["cells"][0][AREA]["mean"] == {"value": 0.7, "low": None, "high": None}
    assert one["notes"][-1] == "there is nothing but paddle to compare"


def test_missing_cells_and_unequal_seeds_are_said_and_left_out_over_all() -> None:
    rows = results(
        {
            ("A", "paddle"): SIX, ("A", "cup"): SIX, ("B", "paddle"): SIX, ("B", "cup"): SIX[:4],
            ("C", "paddle"): SIX,
        }
    )  # fmt: skip
    told = comparison_document(rows)
    assert told["overall"]["scenarios"] == ["A", "B"]
    assert "unequal seeds: cup in B lacks 4-5" in told["notes"]
    assert "no results of cup in C; over all is over A, B" in told["notes"]
    assert only(told["against"], scenario="B")["pairs"] == 4
    assert [row["scenario"] for row in told["against"]] == ["A", "B", None]


def test_seeds_that_differ_make_no_pairs() -> None:
    rows = [result("A", "paddle", seed, 0.8) for seed in range(6)]
    rows += [result("A", "cup", seed, 0.6) for seed in range(6, 12)]
    told = comparison_document(rows)
    row = only(told["against"], scenario="A")
    assert row["pairs"] == 0 and row[AREA]["difference"] is None
    assert row[AREA]["verdict"] == "ahead"


def test_frames_that_never_sufficed_are_more_than_any(capsys) -> None:
    told = comparison_document(results({("A", "paddle"): SIX, ("A", "cup"): [0.6, 0.6, 0.4, 0.4, 0.4, 0.4]}))
    cup = only(told["cells"], label="cup")["frames_to_success"]
    assert cup["reached"] == 2 and cup["median"]["value"] == math.inf
    row = only(told["against"], scenario="A")["frames_to_success"]
    assert row["difference"] is None
    assert (row["probability_of_improvement"]["value"], row["verdict"]) == (1.0, "ahead")
    assert only(told["best"], figure="frames_to_success")["labels"] == ["paddle"]
    print_text(compared_parts(told, "frames_to_success"))
    assert "never [333,333, never]" in capsys.readouterr().out


def test_variants_stand_beside_each_other() -> None:
    rows = results({("A", "paddle"): SIX})
    rows += [result("A", "paddle", s, area - 0.2, variant="γ 1/0") for s, area in enumerate(SIX)]
    told = comparison_document(rows, of="paddle, γ 1/0")
    assert told["labels"] == ["paddle", "paddle, γ 1/0"]
    assert told["verdicts"][AREA] == ["paddle, γ 1/0 is behind paddle in A (area under the curve, 6 seeds)"]


def test_scenarios_of_one_name_on_two_targets_are_two() -> None:
    rows = results({("A", "paddle"): SIX, ("A", "cup"): SIX})
    rows += [result("A", name, 0, 0.7, target="OpenGoal") for name in ("paddle", "cup")]
    names = [place["scenario"] for place in comparison_document(rows)["places"]]
    assert names == ["A (BlockedBoxUnlockPickup)", "A (OpenGoal)"]


def test_of_one_cell_the_newest_run_counts() -> None:
    rows = [result("A", "paddle", 0, 0.9, run="run-10"), result("A", "paddle", 0, 0.1, run="run-9")]
    told = comparison_document(rows)
    assert told["cells"][0][AREA]["mean"]["value"] == 0.9
    assert any(note.startswith("older results left out: 1") for note in told["notes"])


def test_runs_of_several_versions_are_said() -> None:
    rows = results({("A", "paddle"): SIX})
    rows += [result("A", "cup", seed, 0.7, code="0.2.0") for seed in range(6)]
    assert comparison_document(rows)["notes"] == [
        "runs of several versions of paddlectl: 0.1.0 (6); 0.2.0 (6)"
    ]


def test_runs_of_unequal_length_are_said() -> None:
    rows = results({("A", "paddle"): SIX}) + [result("A", "cup", s, 0.7, frames=200_000) for s in range(6)]
    (note,) = comparison_document(rows)["notes"]
    assert note.endswith("A (paddle 400,000, cup 200,000)")
    rows[0] = result("A", "paddle", 0, 0.9, frames=2_000)
    (note,) = comparison_document(rows[:6])["notes"][:1]
    assert note.endswith("A (paddle 2,000 to 400,000)")


def test_runs_that_are_too_short_for_figures_are_left_out_and_of_few_episodes_said() -> None:
    none = dict.fromkeys(("jump_start", "final_score", "final_success", "area_under_curve"))
    rows = results({("A", "paddle"): SIX, ("A", "cup"): SIX})
    short = dataclasses.replace(rows[-1], **none)
    few = dataclasses.replace(rows[0], episodes=14)
    document = comparison_document([few, *rows[1:-1], short])
    assert [cell["n"] for cell in document["cells"]] == [6, 5]
    notes = " ".join(document["notes"])
    assert "left out, as they are too short to have figures: 1" in notes
    assert "runs of fewer than 100 episodes, whose figures are of few: paddle in A" in notes
    with pytest.raises(UsageError, match="no run is long enough to have figures"):
        comparison_document([short])
    assert [panel.title for panel in panels_of([short, rows[0]], "frames")] == ["A"]
    assert panels_of([short], "frames") == []


def test_there_is_no_optimality_gap_outside_of_0_to_1() -> None:
    scores = {(place, name): moved(3.0) for place in "AB" for name in ("paddle", "cup")}
    told = comparison_document(results(scores))
    assert told["overall"]["labels"][0][AREA]["optimality_gap"] is None
    assert any("no optimality gap" in note for note in told["notes"])


def test_the_same_runs_in_several_scenarios_count_once() -> None:
    """What reuses nothing is run once for all scenarios of a target."""
    shared = [
        result(place, "hdm", s, area, run=f"run-{s + 1}") for place in "ABCD" for s, area in enumerate(SIX)
    ]
    own = results({(place, "hdm"): SIX for place in "ABCD"})
    width = {}
    for name, rows in (("shared", shared), ("own", own), ("one", own[:6])):
        told = comparison_document(rows)
        estimate = (told["overall"]["labels"] or told["cells"])[0][AREA]["mean"]
        width[name] = estimate["high"] - estimate["low"]
    assert width["shared"] == pytest.approx(width["one"], rel=0.05)
    assert width["own"] < 0.7 * width["one"]


def test_an_unknown_label_is_told_the_nearest() -> None:
    with pytest.raises(NotFoundError) as caught:
        comparison_document(results({("A", "paddle"): SIX, ("A", "cup"): SIX}), of="padle")
    assert caught.value.hint == "did you mean paddle? or one of: paddle; cup"


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("columns", [60, 80, 120])
def test_it_is_readable_at_any_width(document, figure, columns, monkeypatch, capsys) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    print_text(compared_parts(document | {"notes": ["x " * 90]}, figure))
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line.rstrip()) <= columns for line in lines)
    assert any("paddle *" in line for line in lines) and any("cup =" in line for line in lines)
    assert "6 seeds" in " ".join(lines)  # how far intervals of so few are to be trusted


def test_names_steer_no_terminal(capsys) -> None:
    rows = [result("A\x1b[2J", name, seed, 0.7) for name in ("paddle", "[red]\x07") for seed in range(2)]
    print_text(compared_parts(comparison_document(rows), AREA))
    out = capsys.readouterr().out
    assert "\x1b[2J" not in out and "\x07" not in out and "[red]" in out


def test_a_file_of_results_comes_back(tmp_path) -> None:
    rows = results({("A", "paddle"): SIX, ("A", "cup"): [0.3]})
    rows.append(dataclasses.replace(rows[0], seed=9, jump_start=None, area_under_curve=None))
    write_results(tmp_path / "x.json", rows)
    assert read_results(tmp_path / "x.json") == rows


@pytest.mark.parametrize(
    "change",
    [
        {"seed": "0"}, {"seed": True}, {"seed": 0.5}, {"scenario": None}, {"jump_start": "0.5"},
        {"area_under_curve": float("nan")}, {"final_score": float("inf")}, {"by_frames": 3},
        {"by_frames": ["x"]}, {"by_episodes": None}, {"frames_to_success": "never"}, {"more": 1},
        {"jump_start": 10**400}, {"frames": 10**400}, {"run": 3},
    ],
)  # fmt: skip
def test_another_file_is_refused(tmp_path, change) -> None:
    path = tmp_path / "x.json"
    write_results(path, [result("A", "paddle", 0, 0.7)])
    (row,) = json.loads(path.read_text())
    path.write_text(json.dumps([row | change]))
    with pytest.raises(InvalidFileError, match=next(iter(change))):
        read_results(path)


@pytest.mark.parametrize("text", ["", "{}x", "3", '"ab"', '{"a": 1}', "[3]", "[null]", "[" * 99_999, "\xff"])
def test_what_is_no_list_of_rows_is_refused(tmp_path, text) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InvalidFileError, match="not a file of results"):
        read_results(path)
