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

from behaviors.reward import RewardSettings
from behaviors.settings import (
    ActionSettings,
    CoordinationSettings,
    CurriculumSettings,
    ExperienceSettings,
    LearningSettings,
    ModelSettings,
    MoverSettings,
)
from coevo.config import FileSettings, WorldSettings, check, file_kind, override, read_toml
from coevo.recipes import is_path, recipe_names, recipe_path

__all__ = [
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
    "reward.channels.earns.giveaway",
    "world.rules.stuck_after_s",
    "world.rules.stuck_within_m",
    "world.rules.stuck_off_goals_m",
    "world.rules",  # after its parts
)
_PRETRAINED = Path(__file__).parent / "pretrained"


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
        happens = {"goal", "kick"}
        happens |= {"conceded"} if self.task == "defend" else {"pass"} if self.task == "pass" else set()
        happens |= {"collision"} if self.mover.kind != "none" else set()
        self.reward.check_events(happens, f"the task {self.task!r} with mover.kind = {self.mover.kind!r}")
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
    """Take a setting out of plain data if it is at its default; of a list, out of each part; of nothing, nothing."""
    if settings is UNSET:
        return
    if isinstance(settings, tuple):
        for part, told in zip(settings, plain, strict=True):
            _leave_out(part, told, path)
        return
    name, _, rest = path.partition(".")
    if rest:
        _leave_out(getattr(settings, name), plain.get(name), rest)
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
