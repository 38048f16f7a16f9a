"""The words of a file of two rooms, and what each needs to make sense."""

from collections.abc import Collection, Mapping

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import Thing
from paddlectl.tasks.minigrid.layouts import Passage

PASSAGES = {passage.name.lower(): passage for passage in Passage}
THINGS = {thing.name.lower(): thing for thing in Thing if thing < Thing.PASSAGE}
FACTS = {str(atom): atom for atom in s.ATOMS}
SUBGOALS = {subgoal.predicate.name: subgoal for subgoal in s.SUBGOALS}

_KEY = (Thing.KEY, Thing.BOX)
_LOOSE = (*_KEY, Thing.BLOCKAGE, Thing.BALL)
NEEDS: Mapping[Atom, tuple[tuple[Thing, ...], ...]] = {
    s.KEY_IN_HAND: (_KEY,),
    s.KEY_IN_SIGHT: (_KEY,),
    s.BLOCKAGE_IN_HAND: ((Thing.BLOCKAGE,),),
    s.BALL_IN_HAND: ((Thing.BALL,),),
    s.OPEN: (),
    s.BLOCKED: (_LOOSE,),
    s.BLOCKAGE_PLACED: ((Thing.BLOCKAGE,), (Thing.YELLOW_TILE,)),
    s.GT_BLOCKAGE: ((Thing.BLOCKAGE,),),
    s.PUT_BLOCKAGE: ((Thing.BLOCKAGE,),),
    s.GT_BOX: ((Thing.BOX,),),
    s.GT_KEY: (_KEY,),
    s.GT_DOOR: (),
    s.PUT_KEY: (_KEY,),
    s.GT_BALL: ((Thing.BALL,),),
    s.GT_GOAL: ((Thing.GOAL,),),
    s.PLACE_BLOCKAGE: ((Thing.BLOCKAGE,), (Thing.YELLOW_TILE,)),
    s.PLACE_BALL: ((Thing.BALL,), (Thing.RED_TILE,)),
}
"""Of each fact and subgoal: one of each of these things must be there."""

_MISSIONS = {
    s.GT_BLOCKAGE: "pick up the yellow ball",
    s.PUT_BLOCKAGE: "put the yellow ball down",
    s.GT_BOX: "open the box",
    s.GT_KEY: "get the key",
    s.GT_DOOR: "open the door",
    s.PUT_KEY: "put the key down",
    s.GT_BALL: "fetch the green ball",
    s.GT_GOAL: "go to the goal",
    s.PLACE_BLOCKAGE: "put the yellow ball at the yellow square",
    s.PLACE_BALL: "put the green ball at the red square",
}


def lacking(symbol: Atom, things: Collection[Thing]) -> str:
    """Which things a fact or subgoal needs that aren't there, `key or box`; empty if none."""
    for needed in NEEDS[symbol]:
        if not set(needed) & set(things):
            return " or ".join(thing.name.lower() for thing in needed)
    return ""


def facts_for(things: Collection[Thing]) -> tuple[Atom, ...]:
    """All facts that may hold where these things are."""
    return tuple(atom for atom in s.ATOMS if not lacking(atom, things))


def subgoals_for(things: Collection[Thing], passage: Passage) -> tuple[Atom, ...]:
    """All subgoals that make sense where these things are; nobody opens a gap."""
    fit = [subgoal for subgoal in s.SUBGOALS if not lacking(subgoal, things)]
    return tuple(each for each in fit if each != s.GT_DOOR or passage is not Passage.GAP)


def mission_of(success: Collection[Atom]) -> str:
    """What is to be done, in MiniGrid's own words."""
    return " and ".join(_MISSIONS[subgoal] for subgoal in success)
