"""An explanation for people: program, Ψ, who led in which scene and why, an episode decision by decision."""

from collections.abc import Iterable, Iterator, Sequence

from rich.console import RenderableType

from paddlectl.registry.records import RunRecord
from paddlectl.report.explanation import PHASES, TARGET
from paddlectl.report.followed import document_parts, followed_parts, shown_contexts
from paddlectl.report.grid import Grid, Head, Heading, Prose, Row
from paddlectl.report.mapping import Labels, labels_for, legend, mapping_table, scene_text
from paddlectl.report.output import clean
from paddlectl.report.programs import minimised_grid, program_parts
from paddlectl.report.standings import Document, SceneMet, Standing, Subgoals, scenes_met
from paddlectl.report.summary import alone_parts, floor_text, header_parts, name_of, short_text, verdict
from paddlectl.report.tables import figure, percent

RARE = 0.002  # share of all decisions below which a scene is only counted
SELDOM = 0.01  # share of a leader's decisions below which a rule is left out
SHORTEST = 20  # minimised clauses that are shown; a soft program has hundreds

# By which rule of `transfer.guidance.RULES` a guide was chosen: told of one decision, and of many.
WHY = {
    "largest": "its Λ is the largest",
    "tie": "others had as large a Λ: a source goes before the target, and between sources one is drawn",
    "penalty": "larger Λs were lowered for what those guides did before in this episode",
    "floor": "no source's Λ is above the target's floor",
    "alone": "the target leads this episode alone",
    # of older runs
    "trial": "forced target trial, to measure it here",
    "novel": "novel-subgoal exploration: no source knows this subgoal",
}
WHY_OFTEN = {
    "largest": "as its Λ was the largest",
    "tie": "by a tie",
    "penalty": "as larger Λs were lowered in that episode",
    "floor": "as no source's Λ was above the target's floor",
    "alone": "as it led the episode alone",
    "trial": "as a forced target trial",
    "novel": "as novel-subgoal exploration",
}


def explanation_parts(document: Document, run: RunRecord) -> list[RenderableType]:
    """Everything, from what the run was to its traced episodes."""
    labels = labels_for(document)
    scenes = scenes_met(document["weights"])
    reuse, documents = document["reuse"], document["documents"]
    return [
        *header_parts(run, labels),
        *([short] if (short := short_text(document["final_episodes"])) else ()),
        *verdict(document, labels),
        *_legend(document),
        *_program(document["program"], run),
        *_psi(document["mapping"], scenes, labels),
        *document_parts(documents, labels),
        *(_guidance(document, run, scenes, labels) if scenes else ()),
        *(followed_parts(reuse, labels) if reuse else ()),
        *(alone_parts(run, documents) if not (scenes or reuse or document["trace"]) else ()),
        *_episodes(document, labels),
    ]


def _legend(document: Document) -> list[RenderableType]:
    bodies = [*(row["scene"] for row in document["weights"]), *shown_contexts(document["reuse"])]
    for program in (document["program"], *document["source_programs"]):
        bodies += [clause["body"] for clause in program["clauses"]] if program else []
    return [legend(bodies)] if bodies else []


def _program(program: Document | None, run: RunRecord) -> list[RenderableType]:
    heading = Heading("Learned program")
    if program is None:
        told = f"No policy was stored: the run is {clean(run.status)}."
        return [heading, told, f"run: paddlectl {'runs' if run.status == 'running' else f'resume {run.id}'}"]
    if not program["clauses"]:
        return [heading, *program_parts(program)]
    return [
        heading,
        _program_table(program["clauses"]),
        *_shortest(program),
    ]


def _program_table(clauses: Iterable[Document]) -> Grid:
    """The raw program, a row for each scene: its subgoals with their probabilities, the likeliest first."""
    heads: dict[tuple[str, ...], list[tuple[float, str]]] = {}
    for clause in clauses:
        heads.setdefault(tuple(clause["body"]), []).append((clause["probability"], clause["head"]))
    heads_of_scenes = ("in the scene", "its subgoals, with their probabilities")
    rows = []
    for body, found in heads.items():
        told = ", ".join(f"{p:.2f} {head}" for p, head in sorted(found, reverse=True))
        rows.append(Row((scene_text(body), clean(told))))
    return Grid([Head(title, breaks=True) for title in heads_of_scenes], rows)


def _shortest(program: Document) -> list[RenderableType]:
    shown = program["minimised"][:SHORTEST]
    more = len(program["minimised"]) - len(shown)
    rest = [f"  and {more} more; run: paddlectl show {clean(program['policy'])}"] if more else []
    return ["What it mostly does, in the shortest clauses:", minimised_grid(shown), *rest]


def _psi(mapping: Document | None, scenes: Sequence[SceneMet], labels: Labels) -> list[RenderableType]:
    if not mapping or not mapping["sources"]:
        return []
    known = {tuple(scene["body"]): scene for scene in mapping["scenes"]}
    met = [known[scene.body] for scene in scenes if scene.body in known]
    heading = Heading(
        f"Ψ in the {len(met)} scenes met, of {len(mapping['scenes'])}; * marks the most similar"
    )
    return [heading, mapping_table(met, labels)]


def _guidance(
    document: Document, run: RunRecord, scenes: Sequence[SceneMet], labels: Labels
) -> list[RenderableType]:
    subgoals = Subgoals(document)
    everything = sum(scene.total for scene in scenes)
    shown = [scene for scene in scenes if scene.total >= RARE * everything]
    parts: list[RenderableType] = [
        Heading("Who led in which scene, and why; * marks who was chosen most"),
        "ψ, Φ and Λ are those of the end of each phase; decisions before were made by earlier ones."
        + floor_text(run),
    ]
    if any("rules" not in row for row in document["weights"]):
        parts.append("This run is of an older version, which did not record why a guide was chosen.")
    for scene in shown:
        parts += [
            Prose(scene_text(scene.body), style="bold"),
            *(Prose(sentence, 2) for sentence in sentences(scene, labels, subgoals)),
            _standings_table(scene, labels),
        ]
    rest = scenes[len(shown) :]
    if rest:
        seldom = sum(scene.total for scene in rest)
        parts.append(f"Seldom met, and told by --json only: {len(rest)} scenes, {seldom:,} decisions.")
    return parts


def sentences(scene: SceneMet, labels: Labels, subgoals: Subgoals) -> list[str]:
    """What is told of each phase: who led, how often, by which rules, and how things stood at its end."""
    return [
        f"{phase.capitalize()}: {' '.join(_told(scene, phase, labels, subgoals))}"
        for phase in PHASES
        if phase in scene.standings
    ]


def _told(scene: SceneMet, phase: str, labels: Labels, subgoals: Subgoals) -> Iterator[str]:
    standings, decisions = scene.standings[phase], scene.decisions[phase]
    leader = standings[0]
    share = percent(leader.chosen / decisions)
    yield f"{name_of(leader.policy, labels)} led {share} of {decisions:,} decisions{_causes(leader)}."
    if leader.chosen:
        likeliest = "likeliest in its final program" if leader.policy == TARGET else "likeliest"
        goal = subgoals(leader.policy, scene.body)
        which = f" ({likeliest}: {goal})" if goal else ""
        yield f"Its subgoal{which} was reached in {percent(leader.reached_share)}."
    yield _end(leader, standings[1:], labels)
    dropped = [name_of(one.policy, labels) for one in standings if one.dropped]
    if dropped:
        yield f"Dropped here by then, as its subgoal was reached too seldom: {', '.join(dropped)}."


def _causes(leader: Standing) -> str:
    """The rules by which it led, with their shares of its decisions; nothing if they weren't recorded."""
    rules = sorted((leader.rules or {}).items(), key=lambda rule: -rule[1])
    told = [
        f"{percent(count / leader.chosen)} {WHY_OFTEN.get(rule) or _unknown(rule)}"
        for rule, count in rules
        if leader.chosen and count >= SELDOM * leader.chosen
    ]
    return f"; of these {', '.join(told)}" if told else ""


def _unknown(rule: str) -> str:
    """A rule of a newer version."""
    return f"by the rule {clean(rule)}"


def _end(leader: Standing, others: Sequence[Standing], labels: Labels) -> str:
    """How the leader and the best of the others stood at the end; not why anyone led before."""
    own = f"its Λ was {figure(leader.weight)} (ψ {figure(leader.similarity)}, Φ {figure(leader.performance)})"
    rival = max(others, key=lambda other: other.weight, default=None)
    beside = f", {name_of(rival.policy, labels)}'s {figure(rival.weight)}" if rival else ""
    return f"At the end of the phase {own}{beside}."


def _standings_table(scene: SceneMet, labels: Labels) -> Grid:
    rows = []
    for phase in PHASES:
        for place, one in enumerate(scene.standings.get(phase, ())):
            cells = (
                phase if place == 0 else "",
                labels(one.policy) + (" *" if place == 0 else ""),
                figure(one.similarity),
                figure(one.performance),
                "dropped" if one.dropped else figure(one.weight),
                percent(one.chosen / scene.decisions[phase]),
                percent(one.reached_share),
            )
            rows.append(Row(cells, "bold" if place == 0 else ""))
    numbers = [Head(title, right=True, spare=True) for title in ("ψ", "Φ", "Λ", "chosen", "reached")]
    return Grid((Head("phase"), Head("policy"), *numbers), rows, indent=2)


# Episodes


def _episodes(document: Document, labels: Labels) -> list[RenderableType]:
    parts: list[RenderableType] = []
    for phase in PHASES:
        decisions = [decision for decision in document["trace"] if decision["phase"] == phase]
        if decisions:
            score = figure(document["trace_scores"][phase])
            parts.append(Heading(f"One {phase} episode, decision by decision; score {score}"))
            parts += [part for decision in decisions for part in _decision(decision, labels)]
    return parts


def _decision(decision: Document, labels: Labels) -> list[RenderableType]:
    missed = "cut off by the horizon" if decision.get("cut") else "not reached"
    end = "reached" if decision["reached"] else missed
    took = f"{decision['steps']} steps, {end}"
    line = f"{decision['step']:>4}  {scene_text(decision['scene'])}"
    who = f"{name_of(decision['guide'], labels)} → {clean(decision['head'])}, {took}"
    return [
        line,
        Prose(who, 6, "bold"),
        *(Prose(f"Why: {why}.", 6) for why in _why(decision)),
        _candidates(decision, labels),
        Prose(clean(decision["clause"]), 6, "dim"),
    ]


def _why(decision: Document) -> Iterator[str]:
    """The rule that chose the guide, in words, if the run recorded it."""
    if "rule" in decision:
        yield WHY.get(decision["rule"]) or _unknown(decision["rule"])


def _candidates(decision: Document, labels: Labels) -> Grid:
    rows = []
    for one in decision["weights"]:
        values = [
            f"{name} {figure(one[field])}"
            for name, field in (("ψ", "similarity"), ("Φ", "performance"), ("Λ", "weight"))
        ]
        rows.append(Row((labels(one["policy"]), *values, "*" if one["policy"] == decision["guide"] else "")))
    return Grid([Head()] * 5, rows, indent=6)
