"""Settings of an experiment: who plays, how games end, how trees are bred, and what they are worth."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from coevo.config.levels import LevelsSettings
from coevo.config.reader import FileSettings, NonNegative, Positive, Settings, Share, check
from coevo.config.world import StartSettings, WorldSettings
from coevo.vocabulary import CATEGORIES, PREFIX, SKILLS

__all__ = [
    "CategorySettings",
    "ConditionSettings",
    "EvaluationSettings",
    "EvolutionSettings",
    "FitnessSettings",
    "FitnessWeights",
    "ForeignSettings",
    "GPSettings",
    "GameSettings",
    "PlayerSettings",
    "RunSettings",
    "VaryingWeights",
    "check_experiment",
]

_NAME = re.compile(r"[A-Za-z]\w{0,31}", re.ASCII)
_LETTERS = "1 to 32 letters, digits and _ that begin with a letter"
_MOST_SKILLS = 32


class PlayerSettings(Settings, frozen=True, kw_only=True):
    """One robot of a game; robots are named r0, r1, ... in their order."""

    team: Annotated[int, Meta(ge=0, le=1)] = 0  # team 0 attacks the goal at x = length, team 1 the one at x = 0
    control: Literal["evolve", "stationary", "tree"] = "evolve"
    tree: str = ""  # with control = "tree": what it plays by for good, such as "IF_ball_is_lost(search, shoot)"
    strength: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0  # share of the speed and turn rate that its drive does
    start: StartSettings

    def __post_init__(self) -> None:
        if self.tree and self.control != "tree":
            raise ValueError(f'tree: a robot plays by a given tree where its control = "tree", got {self.control!r}')
        if self.control == "tree" and not self.tree.strip():
            raise ValueError('control = "tree" needs a tree, such as tree = "IF_ball_is_lost(search, shoot)"')


class GameSettings(Settings, frozen=True, kw_only=True):
    """When a game ends, and where the ball starts; what counts as a pass and a collision: see RuleSettings."""

    kind: Literal["soccer"] = "soccer"  # a game of one's own has module:factory here, and settings of its own
    time_limit_steps: Annotated[int, Meta(ge=1, le=100_000)] = 1000  # [C] a game ends with a goal or with time [T]
    ball_start: StartSettings


class CategorySettings(Settings, frozen=True, kw_only=True):
    """Limits of the image categories of Table 6.1.

    The limits of area are about terciles over the visible samples of random play in the dissertation's conditions,
    which 'coevo reproduce categories' measures.
    """

    left_below_px: Positive = 64.0 / 3.0  # [C] thirds of the image
    right_from_px: Positive = 128.0 / 3.0
    ball_small_below_px: NonNegative = 20.0
    ball_large_from_px: NonNegative = 60.0
    goal_small_below_px: NonNegative = 35.0
    goal_large_from_px: NonNegative = 80.0
    robot_small_below_px: NonNegative = 25.0
    robot_large_from_px: NonNegative = 65.0


class ConditionSettings(Settings, frozen=True, kw_only=True):
    """A condition beside those of Table 6.1: what it can be asked about, and when it holds while that is visible."""

    objects: Annotated[tuple[Literal["ball", "own_goal", "opponent_goal", "robot"], ...], Meta(min_length=1)]
    expression: str  # such as "area >= 400 and x >= 20 and x < 44"; coevo.soccer.conditions says what is read


Questions = Annotated[tuple[str, ...], Meta(min_length=1)]


class GPSettings(Settings, frozen=True, kw_only=True):
    """Genetic programming, Table 6.3."""

    population: Annotated[int, Meta(ge=2, le=100_000)] = 80  # [T] for each robot
    generations: Annotated[int, Meta(ge=1, le=100_000)] = 60  # [T] the print lost a digit: "?0"
    tournament: Annotated[int, Meta(ge=1, le=1000)] = 10  # [T]
    crossover: Share = 0.85  # [T] lost in print; reproduction and mutation leave 85 %
    reproduction: Share = 0.05  # [T]
    mutation: Share = 0.10  # [T]
    elite: Annotated[int, Meta(ge=0, le=100)] = 1  # [T] the best survives
    creation_depth_min: Annotated[int, Meta(ge=0, le=14)] = 2  # [C] ramped half and half
    creation_depth_max: Annotated[int, Meta(ge=0, le=14)] = 10  # [T]
    crossover_depth_max: Annotated[int, Meta(ge=1, le=90)] = 25  # [T] mutation may exceed it, as Table 6.4 shows
    mutation_depth_max: Annotated[int, Meta(ge=0, le=14)] = 5  # [C] grown subtree
    leaf_probability: Share = 0.1  # [C] of a crossover point, Koza (1992)
    # any: branches of each parent, wherever they are. same-context: reached by the same answers to the same questions.
    crossover_points: Literal["any", "same-context"] = "any"
    # Small changes of each child, how many in the mean: leaves that choose anew, conditions put above a leaf or branch
    # (their other branch is a new leaf), and conditions in the place of others.
    changed_leaves: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    inserted_conditions: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    changed_conditions: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    # The share of the first two whose place is where a walk from the root ends, not any leaf: it takes either branch
    # with equal chance. One that looks for the place of a condition ends at each condition with a chance of walk_stop.
    walked_changes: Share = 0.0
    walk_stop: Share = 0.2
    simplify: bool = False  # each child is simplified, before its small changes: what a tree does stays the same
    variation: Literal["genetic", "random"] = "genetic"  # random: all but the elite made anew, as a control
    # Given trees by name of the role: they take the first places of its first population.
    start: dict[str, tuple[str, ...]] = msgspec.field(default_factory=dict)
    # Questions by name of the role: its new trees are decision tables of them, with leaves at random. Of each list the
    # first that holds decides, or that none does; then the next list is asked.
    decision_tables: dict[str, tuple[Questions, ...]] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        total = self.crossover + self.reproduction + self.mutation
        if not math.isclose(total, 1.0, abs_tol=1e-9):
            raise ValueError(f"crossover + reproduction + mutation must be 1, got {total:g}")
        if self.creation_depth_min > self.creation_depth_max:
            raise ValueError(f"creation_depth_min must be at most creation_depth_max, got {self.creation_depth_min}")
        if self.elite >= self.population:
            raise ValueError(f"elite must be smaller than population {self.population}, got {self.elite}")
        for name, trees in self.start.items():
            if len(trees) > self.population:
                raise ValueError(f"start.{name}: expected at most population {self.population} trees, got {len(trees)}")


class FitnessWeights(Settings, frozen=True, kw_only=True):
    """The constants of the fixed fitness, Table 6.2."""

    alpha_g: NonNegative = 1.0  # goals missing
    alpha_l: NonNegative = 0.5  # [T] lost goals
    alpha_k: NonNegative = 1e-3  # [T] kicks missing to beta
    alpha_c: NonNegative = 5e-3  # [T] collisions
    alpha_s: NonNegative = 1e-4  # [T] steps
    beta: NonNegative = 4000.0  # [T] steps of contact that are enough; 200 a game


class VaryingWeights(FitnessWeights, frozen=True, kw_only=True):
    """The constants of the varying fitness, Table 6.2."""

    alpha_l: NonNegative = 1.0  # [T]
    alpha_k: NonNegative = 1e-2  # [T] at the first generation, less and less then
    alpha_c: NonNegative = 1e-2  # [T] more and more
    alpha_s: NonNegative = 1e-2  # [T] more and more


class FitnessSettings(Settings, frozen=True, kw_only=True):
    """Which fitness function, and the constants of both; smaller is better."""

    kind: str = "fixed"  # fixed, varying, or module:function of one's own
    fixed: FitnessWeights = FitnessWeights()
    varying: VaryingWeights = VaryingWeights()

    def __post_init__(self) -> None:
        if self.kind not in ("fixed", "varying") and ":" not in self.kind:
            raise ValueError(f"kind must be 'fixed', 'varying' or module:function of your own, got {self.kind!r}")


class EvaluationSettings(Settings, frozen=True, kw_only=True):
    """How individuals meet."""

    games: Annotated[int, Meta(ge=1, le=100_000)] = 20  # [T] that count for each individual of a generation
    # [T] random: each individual plays in one group a generation. docs/how-to/grouping.md says what the others do.
    grouping: Literal["random", "partners", "best", "hall-of-fame"] = "random"
    # At most, in rounds into which the games are divided: fewer where so many do not divide them.
    partners: Annotated[int, Meta(ge=1, le=1000)] = 1
    starts: Literal["own", "common"] = "own"  # common: all groups of a round begin their games alike
    hall_share: Share = 0.5  # of the rounds, played against champions of earlier generations; with hall-of-fame
    # Teams that do not evolve: a finished run, whose champions then stand here as trees by name of the role; "": none.
    against: str | dict[str, str] = ""
    against_share: Share = 1.0  # of the rounds, played against them
    # At least so many games choose the last champions once more, in blocks of ``games``; 0: none.
    champion_games: Annotated[int, Meta(ge=0, le=1_000_000)] = 0

    @property
    def rounds(self) -> int:
        """Into how many rounds the games are divided: as many as there may be partners, if they divide the games."""
        if self.grouping == "random":
            return 1
        return next(rounds for rounds in range(min(self.partners, self.games), 0, -1) if self.games % rounds == 0)

    @property
    def against_rounds(self) -> int:
        """How many of the rounds are played against teams that do not evolve, rounded half up."""
        return math.floor(self.against_share * self.rounds + 0.5) if self.against else 0

    @property
    def hall_rounds(self) -> int:
        """How many of the other rounds are played against champions of earlier generations, rounded half up."""
        rest = self.rounds - self.against_rounds
        return math.floor(self.hall_share * rest + 0.5) if self.grouping == "hall-of-fame" else 0

    @property
    def champion_blocks(self) -> int:
        """How many times ``games`` choose the last champions once more, rounded up; 0 for none."""
        return -(-self.champion_games // self.games)


class EvolutionSettings(FileSettings, frozen=True, kw_only=True):
    """What every experiment of evolution has, whatever is played."""

    kind: Literal["evolution"] = "evolution"
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")] = "run"  # a part of the run folder's name
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    gp: GPSettings = GPSettings()
    fitness: FitnessSettings = FitnessSettings()
    evaluation: EvaluationSettings = EvaluationSettings()
    # Teams that 'coevo baselines' puts beside the champions: each a name, and the trees of one team's robots by theirs.
    hand_typed: tuple[dict[str, str], ...] = ()
    levels: LevelsSettings | None = None  # an environment that co-evolves (6.5); without, it stays as it is


class ForeignSettings(EvolutionSettings, frozen=True, kw_only=True):
    """An experiment with a game of one's own: ``game.kind`` is module:factory, what else ``game`` holds is for it."""

    game: dict[str, Any]

    def __post_init__(self) -> None:
        kind = self.game.get("kind")
        if not isinstance(kind, str) or ":" not in kind:
            raise ValueError(f"game.kind: expected 'soccer' or module:factory of your own, got {kind!r}")


class RunSettings(EvolutionSettings, frozen=True, kw_only=True):
    """An experiment with soccer: 'coevo evolve' takes exactly this."""

    world: WorldSettings = WorldSettings()
    game: GameSettings
    players: Annotated[tuple[PlayerSettings, ...], Meta(min_length=1, max_length=6)]
    categories: CategorySettings = CategorySettings()
    conditions: dict[str, ConditionSettings] = msgspec.field(default_factory=dict)
    # The terminals: installed skills or skill files; beside these four, which "" takes away.
    skills: dict[str, str | bool] = msgspec.field(default_factory=dict)
    skills_elsewhere: Literal["refuse", "allow"] = "refuse"  # skills that were learned for another world

    @property
    def terminals(self) -> dict[str, str]:
        """The terminals in their order, each with its skill: those of Table 6.1, then those that were added."""
        return {name: source for name, source in self.skills.items() if isinstance(source, str) and source}

    def __post_init__(self) -> None:
        skills = {**{name: name for name in SKILLS}, **{name: source or "" for name, source in self.skills.items()}}
        msgspec.structs.force_setattr(self, "skills", skills)
        _check_skills(skills, len(self.terminals))
        _check_conditions(self.conditions)
        if all(player.control != "evolve" for player in self.players):
            raise ValueError('players: at least one must have control = "evolve"')
        field = self.world.field
        starts = [("game.ball_start", self.game.ball_start, self.world.ball.radius_m)]
        starts += [(f"players.{i}.start", p.start, self.world.robot.radius_m) for i, p in enumerate(self.players)]
        for name, start, radius in starts:
            for axis, (low, high), size in (
                ("x_m", start.x_m, field.length_m),
                ("y_m", start.y_m, field.width_m),
            ):
                if low < radius or high > size - radius:
                    limits = f"[{radius:g}, {size - radius:g}]"
                    raise ValueError(f"{name}.{axis} must lie within {limits} on this field, got [{low:g}, {high:g}]")


def _check_skills(skills: Mapping[str, str | bool], terminals: int) -> None:
    for name, source in skills.items():
        if not _NAME.fullmatch(name) or name.startswith(PREFIX):
            raise ValueError(f"skills: names are {_LETTERS}, and do not begin with {PREFIX}; got {name!r}")
        if source is True:
            raise ValueError(f'skills.{name}: expected a skill, or "" to take the terminal away, got true')
    if not 1 <= terminals <= _MOST_SKILLS:
        raise ValueError(f"skills: expected 1 to {_MOST_SKILLS} that are not taken away, got {terminals}")


def _check_conditions(conditions: Mapping[str, ConditionSettings]) -> None:
    for name, condition in conditions.items():
        if not _NAME.fullmatch(name) or "_is_" in name:
            raise ValueError(f"conditions: names are {_LETTERS}, and do not hold _is_; got {name!r}")
        if name in CATEGORIES:
            raise ValueError(f"conditions.{name}: Table 6.1 has a condition of this name; choose another")
        if len(set(condition.objects)) < len(condition.objects):
            raise ValueError(f"conditions.{name}.objects: expected each object once")


def check_experiment(data: Mapping[str, Any], source: str) -> EvolutionSettings:
    """Make the settings of an experiment from plain data: of soccer, or of a game of one's own if it names one.

    Raises:
        InputError: as of ``check``.
    """
    game = data.get("game")
    soccer = not isinstance(game, Mapping) or game.get("kind", "soccer") == "soccer"
    kind: type[EvolutionSettings] = RunSettings if soccer else ForeignSettings
    return check(kind, data, source)
