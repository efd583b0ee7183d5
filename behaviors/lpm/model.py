"""Local prediction model: a state estimated from the last few actions and observations of one object.

The model is the linear state-space model of Uchibe 1999 (3.1), identified by Larimore's canonical variate
analysis (appendix A): the state is the part of the recent past that says most of the near future.

Timing. ``actions[t]`` is the action that LED TO ``observations[t]``. The past of time t is, newest first
(3.2)::

    p_t = [u_{t-1} .. u_{t-l}, y_{t-1} .. y_{t-l}]

and the state is x_t = M (p_t - past_mean), (A.9). So x_t knows all rows up to t - 1, and x_t with
``actions[t]`` predicts ``observations[t]``. The state that knows the newest observation, the one to choose
the next action with, is one row further on: `LocalPredictionModel.latest_state`.
"""

from __future__ import annotations

import operator
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from behaviors.lpm.cva import RELATIVE_CUTOFF, lagged, relative_conditioning
from behaviors.lpm.segments import Signals, check_segment, check_segments
from behaviors.lpm.selection import (
    MAX_HISTORY_LENGTH,
    Analysis,
    Candidate,
    by_gain,
    by_norm,
    by_regression,
    fixed,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = ["MAX_HISTORY_LENGTH", "LocalPredictionModel", "PersistentExcitationWarning", "identify"]

Array = NDArray[np.float64]

_EXCITATION_LIMIT = 1e-6  # smallest over largest eigenvalue of the block-Hankel covariance of the inputs


class PersistentExcitationWarning(UserWarning):
    """The actions vary too little to tell their effects apart."""


@dataclass(frozen=True, eq=False)
class LocalPredictionModel:
    """A state-space model and the memory matrix that estimates its state; made by `identify`.

    All in the units of the training data, with m inputs, q outputs, history length l and order n.

    Attributes:
        history_length: l, how many past steps the state is made from.
        order: n, the dimension of the state.
        memory_matrix: (n, l (m + q)): [I_n 0] M, (A.9) and (A.10).
        past_mean: (l (m + q),): mean of p_t over the training windows.
        contribution: (rank,): all mu, descending, within [0, 1]: correlation of each element of the state,
            also beyond the order, with the future, (A.8).
        A: (n, n), of (A.11), for mean-free inputs and outputs.
        B: (n, m), the same.
        C: (q, n), the same.
        D: (q, m), the same.
        residual_covariance: (q, q): R, covariance of the one-step error on the training windows, (3.5).
        aic: (rank,): AIC(n) for n = 1 .. rank at this history length, (3.6).
        action_mean: (m,): mean of u_t over the training windows.
        observation_mean: (q,): mean of y_t over the training windows.
    """

    history_length: int
    order: int
    memory_matrix: Array
    past_mean: Array
    contribution: Array
    A: Array
    B: Array
    C: Array
    D: Array
    residual_covariance: Array
    aic: Array
    action_mean: Array
    observation_mean: Array

    @property
    def inputs(self) -> int:
        """Length of an action, m."""
        return len(self.action_mean)

    @property
    def outputs(self) -> int:
        """Length of an observation, q."""
        return len(self.observation_mean)

    def states(self, actions: ArrayLike, observations: ArrayLike) -> Array:
        """Estimate the state of every row of one segment, (A.9).

        Args:
            actions: (T, m), NaN where nothing is known.
            observations: (T, q), NaN where the object was not seen.

        Returns:
            (T, n): row t is x_t, made from rows t - l .. t - 1 and not from row t. It is NaN where that
            history is not complete: in the first l rows and in the l rows after a NaN.

        Raises:
            ValueError: for arrays of another shape, or infinite values.
        """
        return self._states_and_next(actions, observations)[:-1]

    def latest_state(self, actions: ArrayLike, observations: ArrayLike) -> Array:
        """Estimate the state after the last row, which the next action is chosen with, (A.9).

        Args:
            actions: (T, m); only the last l rows matter.
            observations: (T, q); only the last l rows matter.

        Returns:
            (n,): x_T, made from rows T - l .. T - 1; NaN where that history is not complete.

        Raises:
            ValueError: for arrays of another shape, or infinite values.
        """
        latest: Array = self._states_and_next(actions, observations)[-1]
        return latest

    def predict(self, actions: ArrayLike, observations: ArrayLike) -> Array:
        """Predict every row of one segment one step ahead, y_t = C x_t + D u_t with means restored, (3.1).

        Args:
            actions: (T, m), NaN where nothing is known.
            observations: (T, q), NaN where the object was not seen.

        Returns:
            (T, q): row t predicts ``observations[t]`` from rows t - l .. t - 1 and ``actions[t]``; NaN where
            that history is not complete.

        Raises:
            ValueError: for arrays of another shape, or infinite values.
        """
        states = self.states(actions, observations)
        deviation = np.asarray(actions, dtype=np.float64) - self.action_mean
        return states @ self.C.T + deviation @ self.D.T + self.observation_mean

    def _states_and_next(self, actions: ArrayLike, observations: ArrayLike) -> Array:
        u, y = check_segment(actions, observations, "the segment")
        if (u.shape[1], y.shape[1]) != (self.inputs, self.outputs):
            raise ValueError(
                f"this model has m = {self.inputs} and q = {self.outputs}, the segment m = {u.shape[1]} and "
                f"q = {y.shape[1]}; use the signals that the model was identified from"
            )
        if np.isinf(u).any() or np.isinf(y).any():
            raise ValueError("the segment holds infinite values; expected finite ones, or NaN for what was not seen")
        states = np.full((len(u) + 1, self.order), np.nan)
        size = self.history_length
        if len(u) >= size:
            past = np.hstack([lagged(u, size), lagged(y, size)])
            states[size:] = (past - self.past_mean) @ self.memory_matrix.T
        return states


def identify(
    segments: Sequence[tuple[ArrayLike, ArrayLike]],
    *,
    history_length: int | None = None,
    order: int | None = None,
    future_inputs: Literal["keep", "project"] = "keep",
    threshold: float | None = None,
    history_rule: Literal["norm", "gain", "aic"] = "norm",
    parameter_count: Literal["entries", "free"] = "entries",
) -> LocalPredictionModel:
    """Identify a local prediction model by canonical variate analysis (Uchibe 1999, 3.2 and appendix A).

    With "keep" the states have unit covariance on the training windows. With "project" the memory matrix is
    U_aux^T Sigma_pp|u^(-1/2), made from the projected covariance but applied to the plain past: reduced to
    the canonical directions, it is the coefficient of p_t when f_t is regressed on p_t and the future actions
    together, and that coefficient multiplies p_t itself. The states then have a variance of 1 or more; what
    exceeds 1 is what future actions tell about them.

    Features may depend exactly on each other: directions with at most 1e-10 of the variance are left out of
    Sigma^(-1/2) and of log|R|, and R counts as at least that share, so that AIC is finite where the
    prediction is perfect. The sign of a state is fixed (its largest weight, per standard deviation of the
    feature, is positive); states whose mu are equal to rounding are determined up to a rotation among them
    only.

    Args:
        segments: one pair (actions (T, m), observations (T, q)) for each stretch in which the object was seen
            without a break, ``actions[t]`` being the action that led to ``observations[t]``. No window
            crosses two segments; those with T < 2l hold none and are skipped.
        history_length: l. None has it chosen by ``history_rule``, up to `MAX_HISTORY_LENGTH` or as long as
            there are 5 windows a variable.
        order: n, at most min(l q, l (m + q), rank). None takes the minimum of AIC(n), (3.6).
        future_inputs: "keep" correlates p_t with f_t as (A.8) is printed. Where actions are held or follow a
            policy, past actions predict future ones, and states are spent on that. "project" first regresses
            u_t .. u_{t+l-1} out of both (Van Overschee and De Moor 1996): the order is then that of the
            system itself.
        threshold: a norm of R that is small enough: the error variance of the least predictable direction,
            where every standardised observation has variance 1. Without effect where ``history_length`` is
            given, or the rule is "aic".
        history_rule: "norm" lengthens the history from 1 until the spectral norm of R (of standardised
            observations, at the order chosen for that l) is small enough, (3.2.3): at most ``threshold``, or, as
            the text gives none, 1 % more than the smallest of all lengths. "gain" stops as soon as one step more
            would shrink that norm by less than 5 %: such a history is short, and may be too short for the order,
            as a state that only a longer one reveals is lost. "aic" takes as many steps as the regression of y_t
            on them and u_t has where its AIC is smallest (Larimore 1990).
        parameter_count: of AIC. "entries" is lambda(n), (3.7), all entries of A to D. "free" is what is left when
            no change of the state's axes counts, with the noise: 2nq + nm + mq + q(q + 1)/2 (Larimore 1990).

    Returns:
        The model of that history length and order.

    Raises:
        ValueError: for segments of wrong or different shapes, values that are not finite, observations that
            never vary, too few windows, and options out of range.

    Warns:
        PersistentExcitationWarning: where the actions are not persistently exciting of order 2l ("project")
            or l + 1 ("keep"), as with one action only.

    Example:
        >>> import numpy as np
        >>> from behaviors.lpm import identify
        >>> random = np.random.default_rng(1)
        >>> actions, state, seen = random.normal(size=(2000, 1)), 0.0, []
        >>> for action in actions[:, 0]:  # a state of one dimension, seen with noise; row t is what actions[t] led to
        ...     state = 0.8 * state + action
        ...     seen.append([state + 0.1 * random.normal()])
        >>> model = identify([(actions, np.array(seen))], history_length=3, order=1)
        >>> model.memory_matrix.shape, model.A.round(1).tolist()
        ((1, 6), [[0.8]])
        >>> error = np.array(seen) - model.predict(actions, np.array(seen))
        >>> bool(np.nanstd(error) < 0.2)
        True
    """
    checked = check_segments(segments)
    length, wanted_order = _count("history_length", history_length), _count("order", order)
    if future_inputs not in {"keep", "project"}:
        raise ValueError(f"future_inputs must be 'keep' or 'project', not {future_inputs!r}")
    if history_rule not in {"norm", "gain", "aic"}:
        raise ValueError(f"history_rule must be 'norm', 'gain' or 'aic', not {history_rule!r}")
    if parameter_count not in {"entries", "free"}:
        raise ValueError(f"parameter_count must be 'entries' or 'free', not {parameter_count!r}")
    if threshold is not None and not threshold > 0.0:
        raise ValueError(f"threshold must be a positive norm of the error covariance, such as 0.1, not {threshold!r}")

    signals = Signals.standardised(checked, shortest_history=length or 1)
    how = Analysis(project=future_inputs == "project", free=parameter_count == "free")
    if length is not None:
        candidate = fixed(signals, how, length, wanted_order)
    elif history_rule == "aic":
        candidate = by_regression(signals, how, wanted_order)
    else:
        choose = by_gain if history_rule == "gain" else by_norm
        candidate = choose(signals, how, wanted_order, threshold)
    _warn_of_weak_excitation(candidate, signals.inputs, project=how.project)
    return _model(signals, candidate, wanted_order or candidate.best_order)


def _model(signals: Signals, candidate: Candidate, order: int) -> LocalPredictionModel:
    """Estimate the parameters by least squares (A.11), and return to the units of the data."""
    windows, size, weights = candidate.windows, candidate.history_length, candidate.variates.weights[:order]
    regressors = np.hstack([candidate.states[:, :order], windows.actions])
    # x_{t+1} has a small mean on these windows; beside mean-free regressors it does not touch the slopes.
    targets = np.hstack([windows.next_past @ weights.T, windows.observations])
    theta = np.linalg.lstsq(regressors, targets, rcond=np.sqrt(RELATIVE_CUTOFF))[0].T  # (A.11)
    residual = windows.observations - regressors @ theta[order:].T

    u_mean, u_scale = signals.action_mean, signals.action_scale
    y_mean, y_scale = signals.observation_mean, signals.observation_scale
    past_mean = np.concatenate([np.tile(u_mean, size), np.tile(y_mean, size)])
    past_scale = np.concatenate([np.tile(u_scale, size), np.tile(y_scale, size)])
    return LocalPredictionModel(
        history_length=size,
        order=order,
        memory_matrix=weights / past_scale,
        past_mean=past_mean + past_scale * candidate.past_mean,
        contribution=candidate.variates.correlations,
        A=theta[:order, :order],
        B=theta[:order, order:] / u_scale,
        C=y_scale[:, None] * theta[order:, :order],
        D=y_scale[:, None] * theta[order:, order:] / u_scale,
        residual_covariance=np.outer(y_scale, y_scale) * (residual.T @ residual) / len(residual),  # (3.5)
        aic=candidate.aic,
        action_mean=u_mean + u_scale * candidate.action_mean,
        observation_mean=y_mean + y_scale * candidate.observation_mean,
    )


def _warn_of_weak_excitation(candidate: Candidate, m: int, *, project: bool) -> None:
    """Warn the caller of `identify` if the block-Hankel covariance of the inputs is (nearly) singular."""
    windows, size = candidate.windows, candidate.history_length
    inputs = np.hstack([windows.past[:, : size * m], windows.future_actions if project else windows.actions])
    conditioning = relative_conditioning(inputs)
    if conditioning < _EXCITATION_LIMIT:
        warnings.warn(
            f"the actions are not persistently exciting of order {inputs.shape[1] // m}: the smallest "
            f"eigenvalue of their block-Hankel covariance is {conditioning:.0e} of the largest, expected at "
            f"least {_EXCITATION_LIMIT:.0e}, so their effects cannot be told apart; record actions that vary "
            "more, each by itself and at irregular times",
            PersistentExcitationWarning,
            stacklevel=3,
        )


def _count(name: str, value: int | None) -> int | None:
    if value is None:
        return None
    try:
        count = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number of at least 1, or None, not {value!r}") from None
    if count < 1:
        raise ValueError(f"{name} must be at least 1, or None to have it chosen, not {count}")
    return count
