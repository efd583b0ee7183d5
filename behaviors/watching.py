"""Trials of what was learned, as what is shown: of a skill alone, of a passer and a shooter, of several robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from msgspec import UNSET

from behaviors.cards import measured_mover
from behaviors.learning import succeeded, watch
from behaviors.recipe import Recipe
from behaviors.schedule.recipe import Schedule
from behaviors.team.recipe import TeamRecipe
from behaviors.trials.scene import Watched
from behaviors.trials.task import COLLISION, FAILURE, GOING, PASSED, STRAY_GOAL, SUCCEEDED, SUCCESS
from coevo.replay import Actor, Recording, Take
from coevo.skill import Skill, load_skill
from coevo.stage import CHASER, ROAMER, STANDING

__all__ = ["pair_recording", "skill_recording", "team_recording"]

_SIDES = ("succeeded", "failed")
_IDLE = {STANDING: "stands", ROAMER: "drives at random"}
_CHASES = {"ball-chaser": "drives at the ball"}
_SUCCESSES = {
    "shoot": "goal",
    "pass": "the mate touches the ball",
    "search": "the ball is found",
    "defend": "goal on the other side",
    "home": "it is at its goal",
}
_SPARED = {"avoid": "collision", "defend": "goal"}
_ENDINGS = {
    FAILURE: "a goal that does not count, or out of the field",
    COLLISION: "collision",
    STRAY_GOAL: "goal, but not by the shooter",
}


def skill_recording(recipe: Recipe, skill: Skill, *, games: int, seed: int, starts: str) -> Recording:
    """Return trials of a skill: the first of those that ``behaviors.cards.measure`` counts with the same arguments.

    Raises:
        InputError: the skill is not one for this task, or no start was found.
    """
    watched = watch(recipe, skill, games=games, seed=seed, starts=starts, mover=measured_mover(recipe))
    takes = []
    for number, one in enumerate(watched):
        success = bool(succeeded(recipe, np.array([one.ends]))[0])
        ending = _ENDINGS.get(one.ends, "time is up")
        if one.ends == SUCCESS:
            ending = _SUCCESSES[recipe.task]
        elif one.ends == FAILURE and recipe.task == "defend":
            ending = "goal against it"
        elif one.ends == GOING and recipe.task in _SPARED:
            ending = f"time is up, and no {_SPARED[recipe.task]}"
        takes.append(_take(one, number, games, ending, success=success, chased=recipe.mover.kind))
    robots = takes[0].trace.skills.shape[1]
    played = _played(recipe)
    against = int(recipe.task == "defend")  # the other robot is of the other team
    actors = tuple(Actor(f"r{number}", number * against, sees=number == 0 or bool(played)) for number in range(robots))
    name = f"{skill.name}: starts {starts}, seed {seed}"
    return _recording(name, recipe, actors, [skill, *played], takes)


def _played(recipe: Recipe) -> list[Skill]:
    """Return the skill that the other robot plays when a skill is measured, if it plays one."""
    mover = measured_mover(recipe) or recipe.mover
    if mover.skill is UNSET:
        return []
    skill = load_skill(mover.skill)
    return [replace(skill, name=f"{skill.name} of r1")]


def pair_recording(
    schedule: Schedule, skills: Sequence[Skill], watched: Sequence[Watched], numbers: Sequence[int], name: str
) -> Recording:
    """Return trials of a passer and a shooter; a success is a goal that the shooter scores.

    Args:
        schedule: their method.
        skills: of both.
        watched: trials of ``behaviors.schedule.course.Course.watch_afterwards``.
        numbers: of these trials among all.
        name: of the whole.
    """
    takes = []
    for number, one in zip(numbers, watched, strict=True):
        passes = f"{one.passes} passes" if one.passes != 1 else "1 pass"
        ending = "goal" if one.ends == SUCCESS else _ENDINGS.get(one.ends, "time is up")
        takes.append(_take(one, number, None, f"{ending}, {passes}", success=one.ends == SUCCESS))
    # The bank of a pair holds for each what it has learned, and what it had before.
    both = [skill for skill in skills for _ in range(2)]
    return _recording(name, schedule, (Actor("P"), Actor("S")), both, takes)


def team_recording(
    recipe: TeamRecipe, skills: Mapping[str, Skill], watched: Sequence[Watched], numbers: Sequence[int], name: str
) -> Recording:
    """Return games of several robots; what is counted is the goals of both sides.

    Args:
        recipe: the game.
        skills: by the names of the robots.
        watched: games of ``behaviors.team.course.TeamCourse.watch_afterwards``.
        numbers: of these games among all.
        name: of the whole.
    """
    names, takes = recipe.names, []
    for number, one in zip(numbers, watched, strict=True):
        scorers = [who for who, counts in zip(names, one.counts, strict=True) if counts[SUCCEEDED]]
        side = {SUCCESS: 0, FAILURE: 1}.get(one.ends, -1)
        ending = "time is up" if side < 0 else f"goal of {scorers[0]}" if scorers else "own goal"
        passes = int(one.counts[:, PASSED].sum())
        words = f"{ending}, {passes} pass{'es' * (passes != 1)}"
        idle = tuple(_IDLE.get(role, "") for role in one.roles)
        takes.append(Take(one.trace, f"game {number + 1}", words, side, idle))
    actors = tuple(Actor(member.name, member.team, sees=member.name in skills) for member in recipe.robots)
    objects = {who: skills[who].objects if who in skills else () for who in names}
    return Recording(name, recipe.world, actors, objects, tuple(takes), shows="actions")


def _take(one: Watched, number: int, of: int | None, ending: str, *, success: bool, chased: str = "chaser") -> Take:
    title = f"trial {number + 1}" if of is None else f"trial {number + 1} of {of}"
    idle = tuple(_IDLE.get(role, "") if role != CHASER else _CHASES.get(chased, "drives at r0") for role in one.roles)
    return Take(one.trace, title, ending, 0 if success else 1, idle)


def _recording(
    name: str, settings: Recipe | Schedule, actors: tuple[Actor, ...], skills: Sequence[Skill], takes: Sequence[Take]
) -> Recording:
    names = [skill.name for skill in skills]
    known = {
        skill.name if n == names.index(skill.name) else f"{skill.name} before": skill.objects
        for n, skill in enumerate(skills)
    }
    return Recording(name, settings.world, actors, known, tuple(takes), kind="trial", shows="actions", sides=_SIDES)
