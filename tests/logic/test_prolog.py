"""Programs run by SWI-Prolog: the same subgoal as here in every scene."""

import random
import shutil
import subprocess
from pathlib import Path

import pytest

from paddlectl.logic.atoms import Predicate
from paddlectl.logic.clauses import Body, Clause, Program
from paddlectl.logic.prolog import fired, format_prolog, prolog_atom
from paddlectl.logic.templates import scenes
from paddlectl.tasks.suite import load, names

needs_prolog = pytest.mark.skipif(
    not shutil.which("swipl"), reason="no SWI-Prolog: apt install swi-prolog-nox"
)


def asked(program: Program, bodies: list[Body], folder: Path) -> list[str]:
    """What SWI-Prolog fires in each scene; `none` where nothing fires."""
    (folder / "program.pl").write_text(format_prolog(program))
    lines = [":- initialization(main).", ":- consult('program.pl')."]
    lines.append("ask(Facts) :- retractall(holds(_)), forall(member(F, Facts), assertz(holds(F))), ")
    lines.append("    ( fires(S) -> print(S) ; print(none) ), nl.")
    questions = [
        f"ask([{', '.join(prolog_atom(lit.atom) for lit in sorted(body) if lit.positive)}])"
        for body in bodies
    ]
    lines.append(f"main :- {', '.join(questions)}, halt.")
    (folder / "ask.pl").write_text("\n".join(lines))
    done = subprocess.run(
        ["swipl", "-q", "ask.pl"], cwd=folder, capture_output=True, text=True, timeout=60, check=True,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.stderr == ""  # no warning either
    return done.stdout.splitlines()


def ours(program: Program, body: Body) -> str:
    head = fired(program, body)
    return "none" if head is None else prolog_atom(head)


@needs_prolog
@pytest.mark.parametrize("task", names())
def test_a_program_fires_the_same_subgoal_in_every_scene(task: str, tmp_path: Path) -> None:
    known, dice = load(task), random.Random(1)
    bodies = list(scenes(known.vocabulary.atoms))
    met = dice.sample(bodies, min(40, len(bodies) * 3 // 4))
    clauses = [Clause(head, body) for body in met for head in known.subgoals if dice.random() < 0.7]
    dice.shuffle(clauses)
    probabilities = [dice.choice([0.1, 0.5, 0.9, 1e-7, 1.0, 0.0, dice.random()]) for _ in clauses]
    program = Program(tuple(clauses), tuple(probabilities))
    asking = bodies if len(bodies) <= 256 else met + dice.sample(bodies, 200)
    assert asked(program, asking, tmp_path) == [ours(program, body) for body in asking]


@needs_prolog
def test_names_that_mean_something_to_prolog(tmp_path: Path) -> None:
    words = [
        "is",
        "mod",
        "dynamic",
        "holds",
        "fires",
        "subgoal",
        "append",
        "member",
        "not",
        "end_of_file",
        "true",
    ]
    facts = [Predicate(word, 1)("is") for word in words[:6]]
    heads = [Predicate(word, 0)() for word in words]
    bodies = list(scenes(facts))
    program = Program(
        tuple(Clause(heads[number % len(heads)], body) for number, body in enumerate(bodies)),
        (0.5,) * len(bodies),
    )
    assert asked(program, bodies, tmp_path) == [ours(program, body) for body in bodies]


@needs_prolog
def test_an_empty_body_always_fires_and_an_empty_program_never(tmp_path: Path) -> None:
    always = Program((Clause(Predicate("gt_key", 0)(), frozenset()),), (1e-05,))
    assert asked(always, [frozenset()], tmp_path) == ["gt_key"]
    assert asked(Program((), ()), [frozenset()], tmp_path) == ["none"]


def test_the_text() -> None:
    has_key, body = Predicate("has_key", 1), {}
    body = frozenset({~_positive(has_key("agent")), _positive(has_key("env"))})
    text = format_prolog(Program((Clause(Predicate("gt_key", 0)(), body),), (1e-05,)))
    assert text.endswith(
        "\nsubgoal(gt_key, 1.0e-05) :-\n    \\+ holds(has_key(agent)),\n    holds(has_key(env)).\n"
    )


def _positive(atom):  # type: ignore[no-untyped-def]
    from paddlectl.logic.atoms import Literal

    return Literal(atom)
