"""An explanation in forty lines: what a run came to, who led early and late, the learned program."""

from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from rich.console import RenderableType

from paddlectl.experiments.curves import WINDOW
from paddlectl.methods.catalogue import METHODS
from paddlectl.registry.records import RunRecord
from paddlectl.report.explanation import PHASES, TARGET
from paddlectl.report.followed import document_parts
from paddlectl.report.grid import Grid, Head, Heading, Row
from paddlectl.report.mapping import Labels, labels_for, scene_text, sources_text
from paddlectl.report.output import clean, height
from paddlectl.report.programs import minimised_grid, program_parts
from paddlectl.report.standings import Subgoals, scenes_met
from paddlectl.report.tables import figure, figures_text, percent, significant

MOST_LINES = 40
MOST = 12  # scenes, and clauses
FREQUENT = 0.01  # share of the decisions from which a scene counts for the verdict
NAMED = 3  # sources, and subgoals of one of them, that the verdict names

TERMS = (
    "Λ is a policy's weight; here, that of the end of each part of the run. At each decision the policy with"
    " the largest Λ leads. It is made of ψ, how similar the logic of two scenes is, and Φ, what its decisions"
    " earned."
)

WEIGHT = "A policy is followed by its weight; --full tells what it is made of."
SCENES = "A scene is written by the facts that hold in it; the other facts don't."

Document = Mapping[str, Any]
Context = tuple[str, ...]


class Phase(NamedTuple):
    """A part of a run.

    Attributes:
        until: Frames at its end.
        scenes: How often each policy led, by scene.
        weights: Its weight there at the end, by scene and policy.
        dropped: Where it isn't asked any more at the end.
    """

    until: int
    scenes: Mapping[Context, Counter[str]]
    weights: Mapping[tuple[Context, str], float]
    dropped: Container[tuple[Context, str]] = ()

    @property
    def total(self) -> int:
        return sum(led.total() for led in self.scenes.values())

    def leader(self, scene: Context) -> tuple[str, float] | None:
        """Who led most of its decisions, and the share of them; None if the scene didn't come up."""
        led = self.scenes.get(scene)
        if not led:
            return None
        ((policy, count),) = led.most_common(1)
        return policy, count / led.total()


def summary_parts(document: Document, run: RunRecord) -> list[RenderableType]:
    """No more than `MOST_LINES`, however many scenes there are."""
    for most in range(MOST, -1, -1):
        parts = _parts(document, run, most)
        if height(parts) <= MOST_LINES:
            return parts
    return _parts({**document, "documents": {}}, run, 0)


def _parts(document: Document, run: RunRecord, most: int) -> list[RenderableType]:
    labels = labels_for(document)
    early, late = phases(document)
    short = short_text(document["final_episodes"])
    told = [
        *header_parts(run, labels),
        *([short] if short else ()),
        *document_parts(document["documents"], labels),
        *verdict(document, labels),
    ]
    if early and most:
        weight, written = ("Λ", figure) if document["weights"] else ("weight", significant)
        told += _leaders(early, late, labels, most, Head(weight, right=True, spare=True), written)
        told += [TERMS + floor_text(run) if document["weights"] else WEIGHT]
    nothing = not (early or document["trace"])
    told += alone_parts(run, document["documents"]) if nothing else []
    told += _program(document["program"], run, most)
    return [*told, "", f"all of it: paddlectl explain {run.id} --full"]


def header_parts(run: RunRecord, labels: Labels) -> list[RenderableType]:
    """What was run, and its figures."""
    return [
        clean(f"{run.id}: {run.method} on {run.task}, seed {run.seed}, {run.frames:,} frames, {run.status}"),
        sources_text(run.sources, labels),
        figures_text(run.results),
        *([clean(f"{run.method}: {METHODS[run.method].summary}")] if run.method in METHODS else []),
    ]


def short_text(final_episodes: int | None) -> str:
    """What a reader must know of the figures of a short run."""
    if final_episodes is None or final_episodes >= WINDOW:
        return ""
    episodes = f"{final_episodes} episode{'s' * (final_episodes != 1)}"
    return f"A short run: its figures of training are over {episodes} instead of {WINDOW}."


def floor_text(run: RunRecord) -> str:
    """What is special about the target's Λ by the run's rules, if it has such."""
    rules = run.settings.get("rules") or {}
    floor, samples = rules.get("target_floor"), rules.get("target_samples")
    if not floor:
        return ""
    if not samples:
        margin = rules.get("target_margin", 0.0)
        return f" The target's Λ is its Φ + {margin:g}, and {floor + margin:g} at least."
    return f" Until the target has led there {samples:g} times, its Λ is {floor:g}; it is never less."


def phases(document: Document) -> tuple[Phase | None, Phase | None]:
    """The early and the late part of the run, as far as they were recorded."""
    if document["weights"]:
        early, late = (
            _guided([row for row in document["weights"] if row["phase"] == phase]) for phase in PHASES
        )
        return early, late
    periods = sorted({row["frames"] for row in document["reuse"]})
    if not periods:
        return None, None
    first, last = (
        _followed([row for row in document["reuse"] if row["frames"] == frames])
        for frames in (periods[0], periods[-1])
    )
    return (first, last) if len(periods) > 1 else (first, None)


def _guided(rows: Sequence[Document]) -> Phase | None:
    scenes, weights, dropped = {}, {}, set()
    for scene in scenes_met(rows):
        (standings,) = scene.standings.values()
        scenes[scene.body] = Counter({one.policy: one.chosen for one in standings})
        weights.update({(scene.body, one.policy): one.weight for one in standings})
        dropped |= {(scene.body, one.policy) for one in standings if one.dropped}
    return Phase(max(row.get("frames", 0) for row in rows), scenes, weights, dropped) if scenes else None


def _followed(rows: Sequence[Document]) -> Phase | None:
    scenes: dict[Context, Counter[str]] = {}
    for row in rows:
        scenes.setdefault(tuple(row["context"]), Counter())[row["source"]] += row["chosen"]
    weights = {(tuple(row["context"]), row["source"]): row["weight"] for row in rows}
    met = {scene: led for scene, led in scenes.items() if led.total()}
    return Phase(rows[0]["frames"], met, weights) if met else None


def verdict(document: Document, labels: Labels) -> list[RenderableType]:
    """Two sentences: who led at first; when the target took over, and where others lead in the end."""
    early, late = phases(document)
    if not early:
        return []
    second = "; ".join([*_taken_over(document), *_at_the_end(late, labels, bool(document["weights"]))])
    second = f" {second[0].upper()}{second[1:]}." if second else ""
    return ["", f"{_at_first(early, late, document, labels)}{second}"]


def _at_first(early: Phase, late: Phase | None, document: Document, labels: Labels) -> str:
    led = sum(early.scenes.values(), Counter[str]())
    until = f"Until frame {early.until:,}" if early.until else "At first"
    until = until if late else "In all,"
    others = early.total - sum(count for _, count in led.most_common(NAMED))
    if not document["weights"]:
        return _followed_at_first(until, led, others, labels)
    subgoals = Subgoals(document)
    told = []
    for policy, count in led.most_common(NAMED):
        goals = _goals(policy, early, subgoals)
        told.append(f"{_share(count, early.total)} by {name_of(policy, labels)}{goals}")
    told += [f"{_share(others, early.total)} by others"] if others else []
    return f"{until} the decisions were led {_joined(told)}."


def _followed_at_first(until: str, followed: Counter[str], others: int, labels: Labels) -> str:
    """The same of a method without decisions."""
    named = [(_itself(policy, labels), count) for policy, count in followed.most_common(NAMED)]
    total = followed.total()
    told = [
        f"{name} in {_share(count, total)}"
        for name, count in [*named, *([("others", others)] if others else [])]
    ]
    told[0] += " of its choices"
    return f"{until} it followed {_joined(told)}."


def _itself(policy: str, labels: Labels) -> str:
    return "itself" if policy == TARGET else labels(policy)


def _share(part: int, total: int) -> str:
    share = part / total
    return "under 1 %" if 0 < share < 0.005 else percent(share)


def _joined(texts: Sequence[str]) -> str:
    """`a, b and c`."""
    *some, last = texts
    return f"{', '.join(some)} and {last}" if some else last


def _goals(policy: str, early: Phase, subgoals: Subgoals) -> str:
    """For which subgoals a source led where it led most."""
    if policy == TARGET:
        return ""
    counts: Counter[str] = Counter()
    for scene, led in early.scenes.items():
        goal = subgoals(policy, scene)
        if goal and led.most_common(1)[0][0] == policy:
            counts[goal] += led[policy]
    named = [goal for goal, _ in counts.most_common(NAMED)]
    return f" (for {', '.join(named)})" if named else ""


def _taken_over(document: Document) -> Iterator[str]:
    """From when on the target led most decisions."""
    moments: dict[int, Counter[str]] = {}
    for row in document["moments"] or document["reuse"]:
        led = moments.setdefault(row["frames"], Counter())
        led[TARGET if row.get("policy", row.get("source")) == TARGET else "others"] += row["chosen"]
    if not moments:
        return
    others = [frames for frames, led in moments.items() if 2 * led[TARGET] <= led.total()]
    led_most = "the target led most of them" if document["weights"] else "it mostly followed itself"
    if not others:
        yield f"{led_most} from the start"
    elif max(others) == max(moments):
        yield (
            "the target never led most of them for good" if document["weights"] else "it never kept to itself"
        )
    else:
        yield f"from frame {max(others):,} on {led_most}"


def _at_the_end(late: Phase | None, labels: Labels, guided: bool) -> Iterator[str]:
    """Where others lead, or are followed, still."""
    if not late:
        return
    frequent = [scene for scene, led in late.scenes.items() if led.total() >= FREQUENT * late.total]
    leaders = [(scene, leader[0]) for scene in frequent if (leader := late.leader(scene))]
    others = [(scene, policy) for scene, policy in leaders if policy != TARGET]
    does = "the target leads" if guided else "it follows itself most often"
    if not others:
        all_ = (
            f"all of the {len(leaders)} scenes that come" if len(leaders) > 1 else "the one scene that comes"
        )
        yield f"in the end {does} in {all_} up most"
        return
    scene, policy = others[0]
    elsewhere = " and elsewhere" if len(others) > 1 else ""
    own = len(leaders) - len(others) or "none"
    yield (
        f"in the end {does} in {own} of the {len(leaders)} scenes that come up most,"
        f" {labels(policy)} in {context_text(scene)}{elsewhere}"
    )


def _leaders(
    early: Phase,
    late: Phase | None,
    labels: Labels,
    most: int,
    weight: Head,
    written: Callable[[float | None], str],
) -> list[RenderableType]:
    """Who led most in each scene, early and late; the most frequent scenes first."""
    columns = {PHASES[0]: early, PHASES[1]: late} if late else {"whole run": early}
    totals: Counter[Context] = Counter()
    for recorded in columns.values():
        totals.update({scene: led.total() for scene, led in recorded.scenes.items()})
    rows = []
    for scene, count in totals.most_common(most):
        cells = [context_text(scene), percent(count / totals.total())]
        for phase in columns.values():
            leader = phase.leader(scene)
            if leader is None:
                cells += ["–", "", ""]
                continue
            there = scene, leader[0]
            value = "dropped" if there in phase.dropped else written(phase.weights.get(there))
            cells += [labels(leader[0]), percent(leader[1]), value]
        rows.append(Row(cells))
    heads = [Head("scene", breaks=True), Head("met", right=True, spare=True)]
    for name in columns:
        heads += [Head(name), Head("led", right=True), weight]
    rest = len(totals) - len(rows)
    more = f"; left out as rare: {rest}" if rest else ""
    return [
        Heading(f"Who led most in each scene{more}"),
        *([SCENES] if _scenes(totals) else []),
        Grid(heads, rows),
    ]


def _scenes(totals: Mapping[Context, int]) -> bool:
    return all(literal.endswith(")") for context in totals for literal in context)


def context_text(context: Context) -> str:
    """A scene by the facts that hold in it; else a name."""
    return scene_text(context) if _scenes({context: 1}) else clean(", ".join(context))


def name_of(policy: str, labels: Labels) -> str:
    """A policy as the text calls it."""
    return "the target itself" if policy == TARGET else labels(policy)


def alone_parts(run: RunRecord, documents: Document) -> list[RenderableType]:
    """Why nothing is told of guides, and what tells how it plays."""
    why = "there were no guides to choose from, and no episode was kept."
    told = [f"{clean(run.method)} learns from scratch: {why}"] if not run.sources else []
    if run.sources and not documents:
        told = ["No choice among its sources was recorded."]
    way = f"How it does on unseen layouts: paddlectl evaluate {run.policy}"
    parts: list[RenderableType] = [*told, *([way] if run.policy else [])]
    return [Heading("Guidance"), *parts] if told else parts


def _program(program: Document | None, run: RunRecord, most: int) -> list[RenderableType]:
    if program is None:
        told = f"No policy was stored: the run is {clean(run.status)}."
        return [told, f"run: paddlectl {'runs' if run.status == 'running' else f'resume {run.id}'}"]
    if not program["clauses"]:
        return program_parts(program)
    shown = program["minimised"][:most]
    more = len(program["minimised"]) - len(shown)
    rest = [f"  and {more} more; run: paddlectl show {clean(program['policy'])}"] if more else []
    return [
        Heading("What it mostly does, in the shortest clauses"),
        *([minimised_grid(shown)] if shown or not rest else []),
        *rest,
    ]
