"""How a skill is learned: a recipe in TOML, checked.

The defaults are what learns best here. What the dissertation has instead is written beside them: with all of it, a
recipe is the learner of chapter 3 to the letter.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from behaviors.raw import RAW_COMPONENTS
from behaviors.reward import RewardSettings
from coevo.config import (
    ComplexitySettings,
    FileSettings,
    NonNegative,
    Positive,
    Settings,
    Share,
    WorldSettings,
    check,
    file_kind,
    override,
    read_toml,
)
from coevo.recipes import is_path, recipe_names, recipe_path

__all__ = [
    "ActionSettings",
    "CoordinationSettings",
    "CurriculumSettings",
    "LearningSettings",
    "ModelSettings",
    "MoverSettings",
    "Recipe",
    "installed_recipes",
    "is_recipe_of",
    "named_recipes",
    "of_seed",
    "plain_recipe",
    "read_recipe",
    "recipe_digest",
]

# Settings younger than the first learned skills, those of ``objects`` of each. A skill file tells them only where they
# differ from their default, so that learning such a skill again gives the same bytes.
_YOUNGER = (
    "kind",
    "description",
    "objects.estimator",
    "objects.lost_states",
    "objects.needed",
    "conceded_reward",
    "ends",
    "credit",
    "learning.method",
    "learning.choice",
    "learning.actor",
    "learning.beta",
    "learning.update",
    "learning.discount_per",
    "learning.storage",
    "learning.patience_steps",
    "world.rules.stuck_after_s",
    "world.rules.stuck_within_m",
    "world.rules.stuck_off_goals_m",
    "world.rules",  # after its parts
)
_PRETRAINED = Path(__file__).parent / "pretrained"
_ObjectKind = Literal["ball", "own_goal", "opponent_goal", "mate", "robot"]


class ModelSettings(Settings, frozen=True, kw_only=True):
    """How the state of one object is estimated: by a local prediction model, or from its features in one image."""

    kind: _ObjectKind
    estimator: Literal["cva", "raw"] = "cva"  # raw: see behaviors.raw; cell and axes are then without effect
    history_length: Annotated[int, Meta(ge=1, le=12)] | None = None  # None: chosen as in 3.2.3; raw: always 1
    order: Annotated[int, Meta(ge=1, le=8)] | None = None  # None: chosen by AIC (3.6); raw: 2, of a goal 3
    cell: Positive = 0.6  # half width of the middle cell in standard deviations; (3.9) has 1
    axes: Literal["varimax", "canonical"] = "varimax"  # which way the state's axes point; see behaviors.lpm.axes
    lost_states: Annotated[int, Meta(ge=1, le=2)] = (
        2  # of an object out of view: 2 tell on which side it was seen last; (3.9) has 1
    )
    # Whether the skill is only for when this object is in view: it is learned in trials that end when it is lost, and
    # stands while it is; see coevo.skill.Skill.domain.
    needed: bool = False
    # Taken whole from this skill, an installed name or a path, instead of estimated: skills that share an object can be
    # coordinated only if they see it through the same model. A path may hold {seed}, that of the learning.
    model_of: str | UnsetType = UNSET

    def __post_init__(self) -> None:
        if self.model_of is not UNSET and (self.estimator, self.history_length, self.order) != ("cva", None, None):
            raise ValueError(
                f"model_of = {self.model_of!r} brings its own estimator, history_length and order: leave them out"
            )
        if self.estimator == "raw":
            if self.history_length not in (None, 1):
                raise ValueError(f"history_length must be 1 with the estimator 'raw', got {self.history_length}")
            most = len(RAW_COMPONENTS[self.kind])
            if self.order is not None and self.order > most:
                raise ValueError(
                    f"order must be at most {most} for {self.kind!r} with the estimator 'raw', got {self.order}"
                )


class ExperienceSettings(Settings, frozen=True, kw_only=True):
    """Random actions from which the models are identified."""

    windows: Annotated[int, Meta(ge=100, le=1_000_000)] = 5000  # steps in view of each object
    hold_min_steps: Annotated[int, Meta(ge=1, le=900)] = 1
    hold_max_steps: Annotated[int, Meta(ge=1, le=900)] = 20
    trial_steps: Annotated[int, Meta(ge=10, le=9000)] = 150
    future_inputs: Literal["keep", "project"] = "keep"


class ActionSettings(Settings, frozen=True, kw_only=True):
    """An action repeats a primitive until the state changes (3.3.1), within these limits."""

    min_steps: Annotated[int, Meta(ge=1, le=900)] = 5
    max_steps: Annotated[int, Meta(ge=1, le=900)] = 30


class LearningSettings(Settings, frozen=True, kw_only=True):
    """Tabular Q learning, or an actor and a critic for the channels of [reward] (chapter 5).

    Either learns with lambda-returns, backwards at the end of a trial, or a step at a time as in (B.2) and (5.7).
    """

    method: Literal["q", "actor-critic"] = "q"
    # Of actor-critic: by what an action is chosen, see behaviors.actor_critic.choice; (5.12) are votes.
    choice: Literal["votes", "votes-then-sum", "sum", "priority"] = "votes"
    # Of actor-critic: the preference moves towards the advantage, p += beta (A - p), or as (5.9) has it, p += beta A.
    actor: Literal["advantage", "literal"] = "advantage"
    beta: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.25  # of actor-critic; it falls as alpha does
    update: Literal["lambda-returns", "one-step"] = "lambda-returns"  # one-step: (B.2), after each decision
    gamma: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.99  # (B.2) has 0.9 an action
    discount_per: Literal["step", "action"] = "step"  # what gamma is for: a physical step, or an action however long
    return_lambda: Share = 0.9  # without effect on one-step
    alpha: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.25
    alpha_visits: Annotated[float, Meta(ge=0.0, le=1e6)] = 20.0  # alpha / (1 + visits / this); 0: alpha is constant
    alpha_min: Share = 0.01  # without effect on a constant alpha
    epsilon_start: Share = 0.2  # 3.5.3
    epsilon_end: Share = 0.02
    easy_share: Share = 0.3  # of the trials, in which the missions grow from easy to full
    anywhere_share: Share = 0.0  # of the trials, which start anywhere though the recipe starts in view
    # How long a trial goes on while an object that the skill needs is out of view; the learner stands meanwhile.
    patience_steps: Annotated[int, Meta(ge=0, le=9000)] = 30
    storage: Literal["dense", "sparse"] = "dense"  # sparse: only states that were visited; see behaviors.tabular.table
    # The greedy policy is checked now and then, on starts of its own, and the table that did best is kept: late
    # updates in aliased cells can spoil a good table.
    check_every: Annotated[int, Meta(ge=0)] = 1000  # trials between two checks; 0: keep the last one
    check_games: Annotated[int, Meta(ge=10, le=100_000)] = 300  # of each kind of start, in view and anywhere
    check_from: Share = 0.3  # share of the trials before the first check


class MoverSettings(Settings, frozen=True, kw_only=True):
    """What the other robot does."""

    # chaser: drives at the learner; ball-chaser: at the ball, as the defender of 4.5.2 does
    kind: Literal["none", "standing", "random", "chaser", "skill", "ball-chaser"] = "none"
    skill: str | UnsetType = UNSET  # with kind "skill": what it plays, an installed name or a path
    speed: Share = 1.0  # of the maximum
    share_of_chasers: Share = 0.0  # with kind "random": share of trials in which it chases instead
    chaser_speed: Share = 0.3

    def __post_init__(self) -> None:
        if (self.kind == "skill") != (self.skill is not UNSET):
            raise ValueError('skill: expected with kind = "skill", and only there: what the other robot plays')


class CoordinationSettings(Settings, frozen=True, kw_only=True):
    """One skill from several that are learned already (appendix B.2); see behaviors.coordination.areas."""

    # Installed names, or paths of skill files, in which {seed} is that of the learning.
    skills: Annotated[tuple[str, ...], Meta(min_length=2, max_length=4)]
    areas: Literal["isodata", "none"] = "isodata"  # "none": all states are learned again
    # Where a skill that only avoids applies: where its values are highest, as (B.3) has it, or where they are lowest.
    avoid_where: Literal["value", "threat"] = "value"
    worth: Literal["steps", "values"] = "steps"  # of a state in an area: by the steps to the goal (B.7), or max ^iQ
    initial: Literal["sum", "blend", "zero"] = "sum"  # values that re-learning begins with
    max_iterations: Annotated[int, Meta(ge=1, le=1000)] = 10  # of ISODATA
    split_std: Positive = 1.0  # clusters wider than this are split; in standard deviations of q
    merge_distance: NonNegative = 0.5  # clusters nearer than this are merged
    steps_trials: Annotated[int, Meta(ge=1, le=1_000_000)] = 5000  # from which the steps to a goal are estimated


class CurriculumSettings(ComplexitySettings, frozen=True, kw_only=True):
    """A world that grows harder while a skill is learned in it, and states that grow with it (chapter 4).

    The recipe's own settings are the task: the hardest world, where models are identified (Fig. 4.3, step 1), and where
    the skill is checked and measured. An observation is a block of trials; rates are shares of them. To learn without
    levels is to begin on the highest (``first``), without growth to begin with all axes (``dimension``).
    """

    trials: Annotated[int, Meta(ge=1, le=100_000)] = 100  # [C] of an observation
    window: Annotated[int, Meta(ge=1, le=10_000)] = 3  # [C] observations
    # Objects whose axes are added, one axis at a time: the first axes of all of them are there from the start.
    # ``dimension`` and ``most_dimensions`` count the axes of these objects.
    grow: tuple[_ObjectKind, ...] = ()
    # model: canonical axes in the order of their mu (4.1, 4.2), turned ones in that of what they say of the image. The
    # others are controls.
    axis_order: Literal["model", "reversed", "random"] = "model"
    new_values: Literal["copy", "zero"] = "copy"  # (4.3), or all values are forgotten when an axis is added, a control
    # Share of the visits, which the learning rate falls with, that is kept when the level or the axes change; 0: it
    # begins anew.
    keep_visits: Share = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.grow)) < len(self.grow):
            raise ValueError("grow: expected each object once")
        if not self.grow and self.most_dimensions:
            raise ValueError("most_dimensions: expected grow with the objects whose axes these are")
        if self.dimension < len(self.grow):
            raise ValueError(f"dimension: expected the first axis of each object in grow, {len(self.grow)} or more")


class Recipe(FileSettings, frozen=True, kw_only=True):
    """One skill, from nothing or, with ``coordination``, from skills that are there."""

    kind: Literal["skill"] = "skill"
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")]  # a part of the folder's name
    task: Literal["shoot", "pass", "avoid", "search", "defend", "home"]
    description: Annotated[str, Meta(max_length=200)] = ""  # what it does, going on from its name; empty: by its task
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    trials: Annotated[int, Meta(ge=1, le=10_000_000)] = 25_000  # [T] a period
    time_limit_steps: Annotated[int, Meta(ge=1, le=100_000)] = 900  # 30 s
    starts: Literal["in-view", "anywhere"] = "in-view"
    goal_reward: Annotated[float, Meta(ge=-1e6, le=1e6)] = 1.0  # [T]
    collision_reward: Annotated[float, Meta(ge=-1e6, le=1e6)] = -0.3  # [T]
    conceded_reward: Annotated[float, Meta(ge=-1e6, le=1e6)] = -1.0  # of the task defend, for a goal against it
    # What ends a trial: whatever happens first of a goal, a collision, and leaving the field; or goals and time alone,
    # as in chapter 5, where the learner may run into another robot several times.
    ends: Literal["event", "goal"] = "event"
    credit: Literal["anyone", "last-touch"] = "anyone"  # of shoot: whose goals are successes
    reward: RewardSettings | UnsetType = UNSET  # of actor-critic, which does not know the three rewards above
    objects: Annotated[tuple[ModelSettings, ...], Meta(min_length=1, max_length=4)]
    mover: MoverSettings = MoverSettings()
    experience: ExperienceSettings = ExperienceSettings()
    action: ActionSettings = ActionSettings()
    learning: LearningSettings = LearningSettings()
    coordination: CoordinationSettings | UnsetType = (
        UNSET  # a recipe without it reads, and hashes, as if it were unknown
    )
    curriculum: CurriculumSettings | UnsetType = UNSET
    world: WorldSettings = WorldSettings()

    def __post_init__(self) -> None:
        if self.action.min_steps > self.action.max_steps:
            raise ValueError(f"action.min_steps must be at most max_steps, got {self.action.min_steps}")
        if self.experience.hold_min_steps > self.experience.hold_max_steps:
            raise ValueError(
                f"experience.hold_min_steps must be at most hold_max_steps, got {self.experience.hold_min_steps}"
            )
        if self.task in ("pass", "avoid", "defend") and self.mover.kind == "none":
            raise ValueError(f"the task {self.task!r} needs another robot: set mover.kind")
        self._check_objects()
        self._check_reward()
        if self.coordination is not UNSET and self.learning.storage == "sparse":
            raise ValueError("learning.storage: with coordination every state has values from the start: 'dense'")
        if self.curriculum is not UNSET:
            self._check_growth(self.curriculum)

    @property
    def is_vector(self) -> bool:
        """Whether it is learned by several rewards; otherwise [reward] is without effect."""
        return self.learning.method == "actor-critic"

    def _check_reward(self) -> None:
        if self.is_vector and self.reward is UNSET:
            raise ValueError('reward: learning.method = "actor-critic" needs [reward] with its channels')
        if self.task != "shoot" and (self.ends, self.credit) != ("event", "anyone"):
            raise ValueError(f"ends and credit are settings of the task 'shoot', got the task {self.task!r}")
        if self.reward is UNSET:
            return
        if self.is_vector and self.coordination is not UNSET:
            raise ValueError("reward: with coordination a skill learns action values; leave out one of them")
        happens = {"goal": True, "conceded": self.task == "defend", "pass": self.task == "pass", "kick": True}
        happens["collision"] = self.mover.kind != "none"
        for channel in self.reward.channels:
            for event in channel.earns.amounts:
                if not happens[event]:
                    raise ValueError(
                        f"reward.channels: {channel.name!r} earns for {event!r}, which never happens in the task"
                        f" {self.task!r} with mover.kind = {self.mover.kind!r}"
                    )
        self.reward.check_powers(self.learning.discount_per)

    def _check_growth(self, curriculum: CurriculumSettings) -> None:
        orders = [model.order for kind in curriculum.grow for model in self.objects if model.kind == kind]
        known = [model.kind for model in self.objects]
        unknown = [kind for kind in curriculum.grow if known.count(kind) != 1]
        if unknown:
            raise ValueError(f"curriculum.grow: expected objects that stand once in objects, got {unknown[0]!r}")
        if None not in orders and curriculum.most_dimensions > sum(order or 0 for order in orders):
            raise ValueError(
                f"curriculum.most_dimensions: {' and '.join(curriculum.grow)} have"
                f" {sum(order or 0 for order in orders)} axes (objects.order), got {curriculum.most_dimensions}"
            )

    def _check_objects(self) -> None:
        kinds = [model.kind for model in self.objects]
        needed = {model.kind for model in self.objects if model.needed}
        if self.task != "pass" and "mate" in kinds and self.mover.kind != "none":
            raise ValueError("objects: only the task 'pass' has a mate; look at 'robot' instead")
        if self.task == "search" and "ball" in needed:
            raise ValueError("objects: the task 'search' is about a ball that is out of view: it cannot be needed")
        if self.coordination is not UNSET:
            if needed:
                raise ValueError("objects: with coordination a skill acts in every state: none can be needed")
            if len(set(kinds)) < len(kinds):
                raise ValueError("objects: with coordination, every object stands once")
        others = [kind for kind in kinds if kind in ("mate", "robot")]
        if others and self.mover.kind == "none":
            raise ValueError(f"objects: {others[0]!r} is another robot, but there is none: set mover.kind")


def plain_recipe(recipe: Recipe) -> dict[str, Any]:
    """Return a recipe as plain data, as a skill file tells it; ``coevo.config.check`` makes an equal recipe of it."""
    plain: dict[str, Any] = msgspec.to_builtins(recipe)
    for path in _YOUNGER:
        _leave_out(recipe, plain, path)
    return plain


def _leave_out(settings: Any, plain: Any, path: str) -> None:
    """Take a setting out of plain data if it is at its default; of a list, out of each part."""
    if isinstance(settings, tuple):
        for part, told in zip(settings, plain, strict=True):
            _leave_out(part, told, path)
        return
    name, _, rest = path.partition(".")
    if rest:
        _leave_out(getattr(settings, name), plain[name], rest)
        return
    (field,) = (field for field in msgspec.structs.fields(settings) if field.name == name)
    if getattr(settings, name) == field.default:
        del plain[name]


def of_seed(source: str, seed: int) -> str:
    """Return where a skill is that a recipe names, with the seed of the learning in place of ``{seed}``.

    Example:
        >>> from behaviors.recipe import of_seed
        >>> of_seed("runs/avoid-study/avoid-n4-seed{seed}/skill.npz", 3)
        'runs/avoid-study/avoid-n4-seed3/skill.npz'
    """
    return source.replace("{seed}", str(seed))


def recipe_digest(recipe: Recipe) -> str:
    """Return the SHA-256 of a recipe."""
    return hashlib.sha256(msgspec.json.encode(plain_recipe(recipe))).hexdigest()


def installed_recipes() -> list[str]:
    """Return the names of the recipes that came with the installation."""
    return sorted(path.parent.name for path in _PRETRAINED.glob("*/recipe.toml"))


def named_recipes() -> dict[str, Path]:
    """Return the files of all recipes of skills that have a name, by that name."""
    return {name: _path(name) for name in [*installed_recipes(), *recipe_names(file_kind(Recipe))]}


def _path(source: str) -> Path:
    """Return the file of an installed skill's recipe, of any other recipe by name, or of a path."""
    installed = installed_recipes()
    if source in installed:
        return _PRETRAINED / source / "recipe.toml"
    return recipe_path(source, file_kind(Recipe), also=installed)


def is_recipe_of(source: str, folder: Path) -> bool:
    """Tell whether the recipe that ``source`` means is the very file in ``folder``, which then is kept."""
    return _path(source).resolve() == (folder / "recipe.toml").resolve()


def read_recipe(source: str, changes: Sequence[str] = ()) -> Recipe:
    """Read an installed recipe by the name of its skill, another recipe by its name, or a TOML file by path.

    Args:
        source: name or path.
        changes: settings to replace, see ``coevo.config.override``.

    Raises:
        InputError: there is no such recipe, it is of another kind, or it is wrong.

    Example:
        >>> from behaviors.recipe import read_recipe
        >>> recipe = read_recipe("search")
        >>> recipe.task, [one.kind for one in recipe.objects]
        ('search', ['ball'])
    """
    data = override(read_toml(_path(source)), changes)
    return check(Recipe, data, source if is_path(source) else f"the recipe of {source}")
