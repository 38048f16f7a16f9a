"""What `explain` tells of any method: who was followed when and where, and the method's own documents."""

import pytest

from paddlectl.cli.app import main
from paddlectl.errors import IntegrityError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.store import Registry
from paddlectl.report import followed
from paddlectl.report.explained import explanation_parts
from paddlectl.report.explanation import explanation_document
from paddlectl.report.output import print_text
from samples import BLOCKED_DOOR, GAP_BALL, TARGET, add_source, add_transfer, body, program, reuse

SOURCES = ("policy-1", "policy-2")
SCENE, RARE = body(TARGET, "EX"), body(TARGET, "")


@pytest.fixture(scope="module")
def registry(tmp_path_factory):
    """Two sources, to which each test adds runs."""
    made = Registry.open(tmp_path_factory.mktemp("followed") / "registry")
    for task, clauses in (("BlockedDoor", BLOCKED_DOOR), ("GapBall", GAP_BALL)):
        add_source(made, task, program(task, clauses))
    add_transfer(made)
    return made


def add(registry, rows=(), documents=None, sources=SOURCES, method="novel"):
    """A run of a method that nobody knows."""
    run = registry.add_run(
        kind="transfer", method=method, task=TARGET, scenario="A", sources=sources, seed=0, settings={},
        versions={},
    )  # fmt: skip
    registry.files.append_rows(run.id, "reuse", rows)
    for name, document in (documents or {}).items():
        registry.files.write_document(run.id, name, document)
    return run.id


def explained(registry, run, capsys):
    document = explanation_document(registry, registry.run(run))
    capsys.readouterr()
    print_text(explanation_parts(document, registry.run(run)))
    return document, capsys.readouterr().out


def row(source, chosen, frames=6000, context=SCENE, weight=0.5, reached=None, **terms):
    return {
        "frames": frames, "context": list(context), "source": source, "terms": terms, "weight": weight,
        "chosen": chosen, "reached": reached,
    }  # fmt: skip


def rows():
    return [
        row("target", 90, 3000, advantage=0.0),
        row("policy-1", 10, 3000, advantage=-0.5),
        row("target", 20, advantage=0.0, weight=0.0),
        row("policy-1", 60, advantage=0.004, weight=0.12),
        row("policy-2", 0, advantage=-0.25, weight=-7.5),
        row("policy-2", 20, context=RARE, advantage=0.5),
    ]


def cells(text, *words):
    """The first line that has these words, with single spaces."""
    return next(" ".join(line.split()) for line in text.splitlines() if all(word in line for word in words))


def test_who_was_followed_over_training(registry, capsys):
    document, told = explained(registry, add(registry, rows()), capsys)
    assert document["reuse"] == rows()
    assert "sources: BlockedDoor (policy-1), GapBall (policy-2)" in told
    assert cells(told, "until frame") == "until frame choices target BlockedDoor GapBall"
    told = told.partition("over training")[2]
    assert cells(told, "3,000") == "3,000 100 90 % 10 % 0 %"
    assert cells(told, "6,000") == "6,000 100 20 % 60 % 20 %"


def test_who_was_followed_in_which_scene_in_the_last_period(registry, capsys):
    _, told = explained(registry, add(registry, rows()), capsys)
    last = told.partition("in the last period")[2]
    assert last.index("{has_key(env), is_blocked(door)}") < last.index("{}")
    assert "80 choices, 80 % of the choices." in last and "20 choices, 20 % of the choices." in last
    assert cells(last, "policy", "followed") == "policy followed weight advantage"
    assert cells(last, "BlockedDoor") == "BlockedDoor * 75 % 0.12 0.004"
    assert cells(last, "target") == "target 25 % 0 0"
    assert cells(last, "GapBall", "0 %") == "GapBall 0 % -7.5 -0.25"
    assert "reached" not in last
    assert "has_ball(agent)" in told.partition("don't.")[0]


def test_what_was_reached_is_told_where_a_method_knows_it(registry, capsys):
    given = [row("target", 5), row("policy-1", 20, reached=15, value=1.0), row("policy-2", 0, reached=0)]
    _, told = explained(registry, add(registry, given), capsys)
    assert cells(told, "weight", "value") == "policy followed weight value reached"
    assert cells(told, "BlockedDoor *") == "BlockedDoor * 80 % 0.5 1 75 %"
    assert cells(told, "target", "20 %", "0.5") == "target 20 % 0.5 – –"
    assert cells(told, "GapBall", "0.5") == "GapBall 0 % 0.5 – –"


def test_a_place_that_is_no_scene_is_told_by_its_name(registry, capsys):
    _, told = explained(registry, add(registry, [row("target", 5, context=["everywhere"])]), capsys)
    assert "\neverywhere\n" in told
    assert "everywhere" not in told.partition("Learned program")[0]


def test_nobody_was_followed_yet(registry, capsys):
    _, told = explained(registry, add(registry, [row("target", 0), row("policy-1", 0)]), capsys)
    assert cells(told, "6,000") == "6,000 0 – –"


def test_much_is_cut_down_to_what_can_be_read(registry, capsys):
    sources = [f"elsewhere:policy-{n}" for n in range(1, 31)]
    run = add(registry, method="wide")
    reuse(registry, run, sources)
    last = [f"policy-{n}" for n in range(1, 31)]
    scenes = [body(TARGET, true) for true in ("", "E", "K", "X", "B", "G", "O", "EX", "EB", "EO", "KO", "GO")]
    given = [
        row(source, number, 1000 * period, context)
        for period in range(1, 41)
        for context in scenes[:1]
        for number, source in enumerate(last)
    ]
    given += [
        row(source, 1 + number, 40_000, context) for number, context in enumerate(scenes) for source in last
    ]
    registry.files.append_rows(run, "reuse", given)
    document, told = explained(registry, run, capsys)
    assert len(document["reuse"]) == len(given)
    assert "20 earlier periods are told by --json only." in told
    assert "others" in told and "elsewhere:policy-30" in told
    assert f"told by --json only: {len(scenes) - followed.MOST_SCENES} scenes" in told
    assert len(told.splitlines()) < 450


def test_sources_of_another_registry_are_not_taken_for_those_here(registry, capsys):
    run = add(registry, [row("policy-1", 5)])
    reuse(registry, run, ["elsewhere:policy-1"])
    _, told = explained(registry, run, capsys)
    assert "sources: elsewhere:policy-1\n" in told
    assert cells(told, "*", "100 %") == "elsewhere:policy-1 * 100 % 0.5"
    assert "BlockedDoor" not in told


def test_a_methods_own_documents_are_told_in_its_own_words(registry, capsys):
    start = {
        "chosen": "policy-1",
        "success_before_learning": {"policy-1": 0.25, "policy-2": 0.0},
        "episodes": 64,
        "kept": True,
        "left": None,
        "tables": [[1], [2]],
        "deep": {"er": {}},
    }
    document, told = explained(registry, add(registry, documents={"start": start}), capsys)
    assert document["documents"] == {"start": start}
    lines = told.partition("\nStart ")[2].splitlines()[1:8]
    assert lines == [
        "chosen: BlockedDoor",
        "success before learning: BlockedDoor 25 %, GapBall 0 %",
        "episodes: 64",
        "kept: yes",
        "left: –",
        "tables: see --json",
        "deep: er see --json",
    ]
    assert "No choice" not in told


def test_a_methods_own_document_is_cut_down_too(registry, capsys):
    many = {f"field_{n}": n for n in range(1000)}
    long = {"all": many, "text": "x" * 10_000, **many}
    _, told = explained(registry, add(registry, documents={"start": long}), capsys)
    assert "and 980 more" in told and "and 982 more; --json has all" in told
    assert len(told) < 4000


def test_a_run_that_recorded_nothing_says_so(registry, capsys):
    _, told = explained(registry, add(registry), capsys)
    assert "No choice among its sources was recorded." in told
    _, told = explained(registry, add(registry, sources=()), capsys)
    assert "novel learns from scratch: there were no guides" in told


DAMAGED = {
    "another source": {"source": "policy-3"}, "a name": {"source": "somebody"}, "no source": {"source": None},
    "frames": {"frames": "6000"}, "less than none": {"frames": -1}, "half a choice": {"chosen": 0.5},
    "true choices": {"chosen": True}, "a debt": {"chosen": -1}, "endless choices": {"chosen": 10**400},
    "context": {"context": "is_open(door)"}, "contexts": {"context": [["is_open(door)"]]},
    "terms": {"terms": [1.0]}, "term": {"terms": {"a": "1"}}, "nothing": {"terms": {"a": None}},
    "many terms": {"terms": {f"t{n}": 1.0 for n in range(13)}}, "weight": {"weight": None},
    "endless weight": {"weight": 10**400}, "reached": {"reached": "all"}, "reached less": {"reached": -1},
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED)
def test_damaged_rows_are_refused(registry, damage):
    run = add(registry, [*rows(), row("target", 1) | damage])
    with pytest.raises(IntegrityError, match=rf"^reuse\.jsonl of {run} isn't what a run writes\n"):
        explanation_document(registry, registry.run(run))


@pytest.mark.parametrize("field", ["frames", "context", "source", "terms", "weight", "chosen"])
def test_a_row_that_lacks_a_field_is_refused(registry, field):
    short = {name: value for name, value in row("target", 1).items() if name != field}
    run = add(registry, [short])
    with pytest.raises(IntegrityError, match=r"reuse\.jsonl"):
        explanation_document(registry, registry.run(run))


@pytest.mark.parametrize("document", [[], "policy-1", 3, None])
def test_a_document_that_is_no_object_is_refused(registry, document):
    run = add(registry, documents={"start": document})
    with pytest.raises(IntegrityError, match=rf"^start\.json of {run} isn't"):
        explanation_document(registry, registry.run(run))


def test_a_document_that_was_lost_is_missed(registry):
    run = add(registry, documents={"start": {}})
    registry.finish_run(run, status="finished", frames=1, episodes=0, seconds=1.0, results={})
    (registry.folder / "runs" / run / "start.json").unlink()
    with pytest.raises(IntegrityError, match=r"start\.json is missing"):
        explanation_document(registry, registry.run(run))


@pytest.mark.parametrize("bad", [False, True])
def test_an_imported_bundle_is_explained_or_refused_in_two_lines(
    registry, tmp_path, capsys, monkeypatch, bad
):
    given = [row("policy-1", 5) | {"context": ["\x1b[2J\ud800", "is_open(door)"], "terms": {"\x1b": 1.0}}]
    run = add(registry, [given[0] | ({"chosen": -5} if bad else {})])
    registry.finish_run(run, status="finished", frames=9, episodes=0, seconds=1.0, results={})
    bundles.export(registry, run, tmp_path / "x.zip")
    monkeypatch.setenv("PADDLECTL_REGISTRY", str(tmp_path / "there"))
    lines = (f"registry import {tmp_path}/x.zip", "explain run-1", "explain run-1 --json")
    codes = []
    for line in lines:
        monkeypatch.setattr("sys.argv", ["paddlectl", *line.split()])
        capsys.readouterr()
        codes.append(main())
        out, err = capsys.readouterr()
        assert "\x1b" not in out + err and len(err.splitlines()) <= 2
    assert codes == ([0, 5, 5] if bad else [0, 0, 0])
