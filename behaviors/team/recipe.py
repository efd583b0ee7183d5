"""The experiments of chapter 5 with several learners as a recipe in TOML, checked: robots, and who learns when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from behaviors.recipe import Recipe
from behaviors.reward import EarnSettings, RewardSettings
from behaviors.settings import (
    ActionSettings,
    ExperienceSettings,
    LearningSettings,
    ModelSettings,
    MoverSettings,
    StoreSettings,
)
from coevo.config import FileSettings, Settings, Share, StartSettings, WorldSettings
from coevo.errors import nearest_name
from coevo.recipes import read_settings

__all__ = ["MemberSettings", "TeamRecipe", "TurnSettings", "mates_of", "model_recipe", "read_team"]

_Trials = Annotated[int, Meta(ge=1, le=10_000_000)]


class MemberSettings(Settings, frozen=True, kw_only=True):
    """One of the robots."""

    name: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9]{0,7}\Z")]
    team: Literal[0, 1] = 0  # 0 attacks the goal at x = length, 1 the other
    objects: Annotated[tuple[ModelSettings, ...], Meta(min_length=1, max_length=5)]  # of its state
    start: StartSettings


class TurnSettings(Settings, frozen=True, kw_only=True):
    """Trials in which the same robots learn. The others play what they have learned, or stand if that is nothing."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9-]{0,15}\Z")]
    learners: tuple[str, ...]
    trials: _Trials | UnsetType = UNSET  # instead of the recipe's
    # again: those who have learned before get models from what they saw last, mapped so that their states mean what
    # they meant; see behaviors.experience.align
    models: Literal["kept", "again"] = "kept"

    def __post_init__(self) -> None:
        if not self.learners:
            raise ValueError(f"learners: nobody learns in {self.name!r}; name a robot, or leave the turn out")


class TeamRecipe(FileSettings, frozen=True, kw_only=True):
    """Robots that learn by turns. Reward, learning and actions are common to all of them, as in the text."""

    kind: Literal["team"] = "team"
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")]
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    robots: Annotated[tuple[MemberSettings, ...], Meta(min_length=2, max_length=4)]
    turns: Annotated[tuple[TurnSettings, ...], Meta(min_length=1, max_length=26)]
    trials: _Trials = 25_000  # [T] a turn
    time_limit_steps: Annotated[int, Meta(ge=1, le=100_000)] = 900  # 30 s
    ball: StartSettings  # where it starts
    in_view: bool = True  # where one robot learns, it sees the ball and the goal that it attacks when a trial begins
    # Whose goal it is: of the robot that touched the ball last, if it is one of the side that scores, or of that side.
    credit: Literal["last-touch", "team"] = "last-touch"
    # [T] the same for all. With learning.method = "q", the sum of the channels is paid, for contact when it begins.
    reward: RewardSettings
    # By what a check chooses the table that is kept: what a trial with the event is worth, of the robots that learn.
    # The numbers of the text, but for collisions: with -1 a robot that does nothing at all may be the best.
    worth: EarnSettings = EarnSettings(goal=1.0, conceded=-1.0, passed=1.0, giveaway=-1.0, collision=-0.3)
    # Of a robot that learns again: share of its visits that is kept, which learning rates fall with. 0: as at first.
    keep_visits: Share = 0.0
    fixed_epsilon: Share = 0.0  # random actions of a robot that plays what it has learned
    games: Annotated[int, Meta(ge=10, le=100_000)] = 1000  # greedy ones that measure all robots after the last turn
    experience: ExperienceSettings = ExperienceSettings()
    store: StoreSettings = StoreSettings()  # for models = "again"
    action: ActionSettings = ActionSettings()
    learning: LearningSettings = LearningSettings(method="actor-critic")
    world: WorldSettings = WorldSettings()

    def __post_init__(self) -> None:
        if self.action.min_steps > self.action.max_steps:
            raise ValueError(f"action.min_steps must be at most max_steps, got {self.action.min_steps}")
        self._check_turns()
        mates = mates_of(self)
        for member, mate in zip(self.robots, mates, strict=True):
            _check_objects(member, has_mate=mate >= 0)
            model_recipe(self, member)  # what is wrong with its objects is told now
        happens = {"goal", "conceded", "kick", "collision"}
        happens |= {"pass"} if max(mates) >= 0 else set()
        happens |= {"giveaway"} if len({member.team for member in self.robots}) > 1 else set()
        self.reward.check_events(happens, f"a game of {', '.join(self.names)}")
        self.reward.check_powers(self.learning.discount_per)

    def _check_turns(self) -> None:
        for what, names in (("robots", self.names), ("turns", [turn.name for turn in self.turns])):
            if len(set(names)) < len(names):
                raise ValueError(f"{what}: expected each name once, got {', '.join(names)}")
        for turn in self.turns:
            for name in turn.learners:
                if name not in self.names:
                    raise ValueError(
                        f"turns: {turn.name!r} lets {name!r} learn, which is none of the robots"
                        f" {', '.join(self.names)}.{nearest_name(name, self.names)}"
                    )
            if len(set(turn.learners)) < len(turn.learners):
                raise ValueError(f"turns: {turn.name!r} names a learner twice: {', '.join(turn.learners)}")
        known: set[str] = set()
        for turn in self.turns:
            if turn.models == "again" and not known & {*turn.learners}:
                raise ValueError(
                    f"turns: {turn.name!r} makes models again, but of {', '.join(turn.learners)} nobody has learned"
                    " before; leave models out"
                )
            known |= {*turn.learners}

    @property
    def names(self) -> list[str]:
        """Of its robots."""
        return [member.name for member in self.robots]

    @property
    def stores(self) -> bool:
        """Whether robots store what they see."""
        return any(turn.models == "again" for turn in self.turns)

    @property
    def is_vector(self) -> bool:
        """Whether robots learn by an actor and a critic for each channel."""
        return self.learning.method == "actor-critic"

    def trials_of(self, turn: TurnSettings) -> int:
        """Return how many trials a turn has."""
        return self.trials if turn.trials is UNSET else turn.trials


def _check_objects(member: MemberSettings, *, has_mate: bool) -> None:
    kinds = [model.kind for model in member.objects]
    if len(set(kinds)) < len(kinds):
        raise ValueError(f"robots: {member.name} has an object twice")
    if "mate" in kinds and not has_mate:
        raise ValueError(f"robots: {member.name} has no mate to look at; look at 'robot' instead")
    for model in member.objects:
        if model.needed or model.model_of is not UNSET:
            raise ValueError(f"robots: {member.name}: needed and model_of are for skills that learn alone")


def mates_of(recipe: TeamRecipe) -> list[int]:
    """Return of each robot the number of its team mate, the first if there are several, and -1 without one."""
    teams = [member.team for member in recipe.robots]
    others = [[k for k, team in enumerate(teams) if team == mine and k != n] for n, mine in enumerate(teams)]
    return [one[0] if one else -1 for one in others]


def model_recipe(recipe: TeamRecipe, member: MemberSettings) -> Recipe:
    """Return the recipe by which a robot acts at random, beside one that moves at random, to get its models."""
    looks_at_mate = any(model.kind == "mate" for model in member.objects)
    return Recipe(
        name=f"{recipe.name}-{member.name}"[:64],
        task="pass" if looks_at_mate else "shoot",
        objects=member.objects,
        mover=MoverSettings(kind="random"),
        experience=recipe.experience,
        action=recipe.action,
        world=recipe.world,
    )


def read_team(name: str, changes: Sequence[str] = ()) -> TeamRecipe:
    """Read a recipe by name or path, with settings replaced by ``dotted.key=value``.

    Raises:
        InputError: there is no such recipe, it is of another kind, or it is wrong.

    Example:
        >>> from behaviors.team.recipe import read_team
        >>> recipe = read_team("chapter5/shoot-and-pass")
        >>> [(turn.name, *turn.learners) for turn in recipe.turns]
        [('A', 'r0'), ('B', 'r1'), ('C', 'r0'), ('D', 'r1')]
    """
    return read_settings(TeamRecipe, name, changes)
