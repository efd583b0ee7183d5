"""Parts of recipes: what a skill sees, tries, learns by, grows with, and who else is there.

The defaults are what learns best here. What the dissertation has instead is written beside them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from behaviors.raw import RAW_COMPONENTS
from coevo.config import ComplexitySettings, NonNegative, Positive, Settings, Share

__all__ = [
    "ActionSettings",
    "CoordinationSettings",
    "CurriculumSettings",
    "ExperienceSettings",
    "LearningSettings",
    "ModelSettings",
    "MoverSettings",
]

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


class StoreSettings(Settings, frozen=True, kw_only=True):
    """The latest experience of a robot, from which its models are identified again."""

    steps: Annotated[int, Meta(ge=100, le=5_000_000)] = 20_000  # N_all of (3.5), of each robot
    least_windows: Annotated[int, Meta(ge=100)] = 1000  # steps in view; of an object seen less, the old model is kept


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
