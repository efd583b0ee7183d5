"""Robots go through the turns of a recipe, a block of trials at a time.

Where it stands can be kept in a file and gone on with; it ends as if it had never stopped.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.ties import ties_drawn
from behaviors.checkpoint import parts_of, read_checkpoint, with_prefix, write_checkpoint
from behaviors.experience import align, identified_again, make_models, stored_stretches, window_count
from behaviors.practice import Practice, Standing, read_results
from behaviors.tabular.decisions import most_decisions
from behaviors.tabular.table import pack_table, unpack_table
from behaviors.team.recipe import TeamRecipe, TurnSettings, mates_of, model_recipe
from behaviors.team.scene import COUNTED, Member, no_start_of, run_games, team_scene, unlearned
from behaviors.team.tables import rates, turn_rows
from behaviors.trials.kernels import Results
from behaviors.trials.minds import pack_store, unpack_store
from behaviors.trials.scene import Watched
from coevo.errors import InputError
from coevo.seeds import SetStream, game_seed, game_seeds, generator
from coevo.skill import Skill
from coevo.skill.bank import CODES
from coevo.skill.estimate import memory_slot
from coevo.skill.model import pack_models, unpack_models

__all__ = ["TeamCourse"]

_BEGIN_ANEW = "remove it, and the learning begins anew"


class TeamCourse:
    """Turns of learning under way, from nothing.

    A robot that does not learn plays by the table that did best in the checks of its last turn; it goes on to learn
    with the last one. Where robots of both sides learn at once nothing is checked: what is better for one is worse for
    the other.

    Args:
        recipe: robots and turns.
        seed: all that happens follows from it.

    Attributes:
        members: the robots, and what they have learned so far.
        results: of the turns that are over, by their names.
        checks: what was found meanwhile, as plain data.
        renewed: which models were made again, and from how many steps in view, as plain data.
    """

    def __init__(self, recipe: TeamRecipe, seed: int, *, members: list[Member] | None = None) -> None:
        self.recipe, self.seed = recipe, seed
        self.members = self._new_members() if members is None else members
        self.results: dict[str, Results] = {}
        self.checks: list[dict[str, Any]] = []
        self.renewed: list[dict[str, Any]] = []
        self._practice: Practice | None = None

    def _new_members(self) -> list[Member]:
        """Return robots that have models and have learned nothing; a turn without a start is found before that."""
        members = unlearned(self.recipe)
        for turn in self.recipe.turns:
            learners = self.learners(turn)
            tables = [members[n].first_table(self.recipe) for n in learners]
            scene = team_scene(self.recipe, members, learners, tables=tables)
            for n in learners:
                scene.grow(n, most_decisions(scene.time_limit, self.recipe.action.min_steps))
            run_games(scene, self.recipe, self.seed, (SetStream.CHECKS, 0), 1, first=1)
        for n, member in enumerate(members):
            seed = int(game_seed(self.seed, SetStream.GATHERING, n) >> np.uint64(1))  # a seed has 63 bits
            member.models, _ = make_models(model_recipe(self.recipe, member.settings), seed)
            member.skill(self.recipe)  # tells whether it has too many states
        return members

    @classmethod
    def load(cls, path: Path, recipe: TeamRecipe, seed: int) -> Self:
        """Go on with what stands in a checkpoint.

        Raises:
            InputError: the checkpoint is damaged, or of another recipe, seed, or version.
        """
        at, arrays = read_checkpoint(path, _identity(recipe, seed), remedy=_BEGIN_ANEW)
        try:
            members = [
                _unpack(member, header, parts_of(member.settings.name, arrays))
                for member, header in zip(unlearned(recipe), at["members"], strict=True)
            ]
            course = cls(recipe, seed, members=members)
            over, told = [turn.name for turn in recipe.turns[: len(at["over"])]], (at["checks"], at["renewed"])
            if at["over"] != over or any(type(rows) is not list for rows in told):
                raise ValueError("it does not tell which turns are over")
            if any(type(row) is not dict for rows in told for row in rows):
                raise ValueError("it does not tell what was found meanwhile")
            course.checks, course.renewed = told
            course.results = {name: read_results(parts_of(f"results.{name}", arrays)) for name in over}
            if at["practice"] is not None:
                course._prepare(Standing.unpack(at["practice"], parts_of("practice", arrays)))
        except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            raise InputError(f"{path} is damaged ({error}); {_BEGIN_ANEW}") from None
        return course

    def save(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        arrays: dict[str, NDArray[Any]] = {}
        headers = []
        for member in self.members:
            header, parts = _pack(member)
            headers.append(header)
            arrays |= with_prefix(member.settings.name, parts)
        for name, found in self.results.items():
            arrays |= with_prefix(f"results.{name}", found._asdict())
        practice = None
        if self._practice is not None:
            practice, parts = self._practice.at.pack()
            arrays |= with_prefix("practice", parts)
        at = {"members": headers, "checks": self.checks, "over": list(self.results)}
        at |= {"renewed": self.renewed, "practice": practice}
        write_checkpoint(path, _identity(self.recipe, self.seed), {**at, "done": self.done}, arrays)

    @property
    def done(self) -> int:
        """How many trials have been run, of all turns."""
        over = sum(len(found.ends) for found in self.results.values())
        return over + (0 if self._practice is None else self._practice.at.done)

    @property
    def trials(self) -> int:
        """How many trials all turns have."""
        return sum(self.recipe.trials_of(turn) for turn in self.recipe.turns)

    @property
    def is_finished(self) -> bool:
        """Whether all turns are over."""
        return len(self.results) == len(self.recipe.turns)

    @property
    def turn(self) -> TurnSettings:
        """The turn under way, or the one that comes next."""
        return self.recipe.turns[len(self.results)]

    def learners(self, turn: TurnSettings) -> list[int]:
        """Return the numbers of the robots that learn in a turn, in their order."""
        return [n for n, name in enumerate(self.recipe.names) if name in turn.learners]

    def advance(self) -> Results:
        """Run the next block of trials; return how they went.

        Raises:
            InputError: no start was found.
        """
        if self._practice is None:
            if self.turn.models == "again":
                self._renew_models()
            self._prepare(None)
        practice = self._practice
        assert practice is not None
        found = practice.advance()
        if practice.is_finished:
            self._end(practice)
        return found

    def _renew_models(self) -> None:
        """Identify the models of those who learn again from what they saw last; values keep their states.

        An object that was in view for fewer than ``store.least_windows`` steps keeps its model, and one whose model the
        stored actions do not excite.
        """
        recipe = self.recipe
        everything = msgspec.structs.replace(recipe.experience, windows=recipe.store.steps)
        for n in self.learners(self.turn):
            member, renewed = self.members[n], []
            if member.values is None or member.store is None:
                continue
            for settings, known in zip(member.settings.objects, member.models, strict=True):
                slot = memory_slot(CODES[settings.kind], n, mates_of(recipe))
                stretches = stored_stretches(member.store, slot, settings.kind)
                windows, model = window_count(stretches), None
                if windows >= recipe.store.least_windows:
                    width = recipe.world.camera.width_px
                    model, _ = identified_again(settings, stretches, everything, image_width=width)
                if model is not None and settings.estimator == "cva":
                    model = align(model, known, stretches)
                told = {"turn": self.turn.name, "robot": member.settings.name, "object": settings.kind}
                self.renewed.append({**told, "windows": windows, "kept": int(model is None)})
                renewed.append(known if model is None else model)
            member.models = tuple(renewed)

    def _prepare(self, standing: Standing | None) -> None:
        """Get the trials of the turn under way ready, from the beginning or from where they stand."""
        recipe, turn, number = self.recipe, self.turn, len(self.results)
        learners, total = self.learners(turn), self.recipe.trials_of(turn)
        tables = [self.members[n].first_table(recipe) for n in learners] if standing is None else standing.tables
        scene = team_scene(recipe, self.members, learners, tables=tables, storing=recipe.stores)
        sides = {self.members[n].settings.team for n in learners}

        def run(first: int, count: int) -> Results:
            return run_games(scene, recipe, self.seed, (SetStream.LEARNING, number), count, first=first, total=total)

        self._practice = Practice(
            scene,
            learners,
            total,
            run,
            check=(lambda: self._check(learners)) if len(sides) == 1 else None,
            rule=recipe.learning,
            standing=standing,
        )

    def _end(self, practice: Practice) -> None:
        """Keep what was learned in a turn."""
        turn = self.turn
        for n, values, table in zip(self.learners(turn), practice.values_kept(), practice.at.tables, strict=True):
            self.members[n].values = self._played(n, values)
            self.members[n].table = unpack_table(
                {name: part.copy() for name, part in pack_table(table).items()}, len(table.rows)
            )
        self.checks += [{"turn": turn.name, **row} for row in practice.at.checks]
        self.results[turn.name] = practice.at.results
        self._practice = None

    def _played(self, robot: int, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the values by which a robot plays, from those of its table."""
        if not self.recipe.is_vector:
            return values
        return ties_drawn(values, generator(self.seed, SetStream.TIES, robot))

    def _check(self, learners: list[int]) -> tuple[float, Mapping[str, float]]:
        """Measure the greedy policies of the tables, on starts that are the same in all checks of a turn."""
        assert self._practice is not None
        now = list(self.members)
        for n, values in zip(learners, self._practice.values_now(), strict=True):
            now[n] = dataclasses.replace(now[n], values=self._played(n, values))
        scene, games = team_scene(self.recipe, now), self.recipe.learning.check_games
        found = run_games(scene, self.recipe, self.seed, (SetStream.CHECKS, len(self.results)), games)
        score = 0.0
        told: dict[str, float] = {}
        for n in learners:
            happened = rates(found, n)
            score += sum(amount * happened[event] for event, amount in self.recipe.worth.amounts.items())
            told |= {f"{event}_{self.recipe.names[n]}": happened[event] for event in COUNTED}
        return score, {**told, "score": score}

    def afterwards(self) -> Results:
        """Let all robots play greedily, on starts that no learning and no check has seen."""
        scene = team_scene(self.recipe, self.members)
        return run_games(scene, self.recipe, self.seed, (SetStream.AFTERWARDS,), self.recipe.games)

    def watch_afterwards(self, skills: Mapping[str, Skill], games: int) -> list[Watched]:
        """Return every step of the first games of ``afterwards``, with what the robots had learned by then.

        Args:
            skills: by the names of the robots, from the files of a finished run; who never learned has none.
            games: how many.

        Raises:
            InputError: no start was found.
        """
        members = [
            dataclasses.replace(member, models=skill.objects, values=skill.values)
            if (skill := skills.get(member.settings.name)) is not None
            else member
            for member in self.members
        ]
        watched = team_scene(self.recipe, members).watch(game_seeds(self.seed, SetStream.AFTERWARDS, count=games))
        if watched is None:
            raise no_start_of(self.recipe)
        return watched

    def skills(self) -> dict[str, Skill]:
        """Return what each robot has learned, by its name; a robot that never learned has nothing."""
        found = {}
        for n, member in enumerate(self.members):
            if member.values is not None:
                about = {"team": msgspec.to_builtins(self.recipe), "robot": self.recipe.names[n], "seed": self.seed}
                found[member.settings.name] = dataclasses.replace(member.skill(self.recipe), about=about)
        return found

    def frequencies(self) -> list[dict[str, Any]]:
        """Return how often what is rewarded happened, a row for each block of trials and robot."""
        rows: list[dict[str, Any]] = []
        before = 0
        for turn in self.recipe.turns:
            if turn.name in self.results:
                found = self.results[turn.name]
                rows += turn_rows(self.recipe, turn, found, before)
                before += len(found.ends)
        return rows


def _identity(recipe: TeamRecipe, seed: int) -> dict[str, Any]:
    """Return what decides the result."""
    return {**msgspec.to_builtins(recipe), "seed": seed}


def _pack(member: Member) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    objects, arrays = pack_models(member.models)
    header: dict[str, Any] = {"objects": objects, "states": None}
    if member.values is not None:
        arrays["values"] = member.values
    if member.table is not None:
        header["states"] = len(member.table.rows)
        arrays |= with_prefix("table", pack_table(member.table))
    if member.store is not None:
        arrays |= with_prefix("store", pack_store(member.store))
    return header, arrays


def _unpack(member: Member, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Member:
    table = None
    if header["states"] is not None:
        table = unpack_table(parts_of("table", arrays), header["states"])
    if member.store is not None:
        unpack_store(member.store, parts_of("store", arrays))
    return dataclasses.replace(
        member, models=unpack_models(header["objects"], arrays), values=arrays.get("values"), table=table
    )
