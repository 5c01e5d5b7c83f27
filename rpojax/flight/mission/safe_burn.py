"""Burn veto and abort burn: the velocity change whose free drift stays clear of the keep-out zone, and of others."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace
from rpojax.flight.mission.drift_clearance import NEAR_SAMPLES, Drift, least_clearance

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]

_SHARES: Final = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Parts of the planned burn that are tried, the first safe one is taken [-]. A choice: steps of a quarter."""

_NO_BURN: Final = len(_SHARES) - 1
"""Place of no burn among these."""

_NEARLY_CLEAR: Final = 0.8
"""Clearance from which a planned burn that is clearer than none may be made at a station [-]. A choice: it leaves four
fifths of the zone; with 1 a burn that leads away but not at once out of it would not be made."""

_ESTIMATE_WEIGHT: Final = 1e-3
"""Weight of the clearance by the estimate alone, which decides where none is left with its uncertainty [-]: it changes
the other by a thousandth at most, so that it decides between equal ones alone."""

_SIZES: Final = (0.05, 0.12, 0.3, 0.6, 1.0)
"""Sizes of other burns over the greatest that can be made in any direction [-]. A choice: the smallest safe one is 1.6
times as large as needed in the mean, 2.5 at most; with half as many 2.3, with twice 1.3."""

_CLEARANCE_WEIGHT: Final = 0.01
"""Weight of the clearance against the size [-]: less than between two sizes (0.07), to decide between equal ones."""

_R: Final = math.sqrt(0.5)
"""Cosine of 45 deg."""
_DIRECTIONS: Final = np.array(
    [
        *((math.cos(angle), math.sin(angle), 0.0) for angle in np.arange(8) * (math.pi / 4.0)),
        *((0.0, 0.0, sign) for sign in (1.0, -1.0)),
        *((0.0, _R * y, _R * z) for y, z in itertools.product((1.0, -1.0), repeat=2)),
    ]
)
"""Directions in H of other burns: all about the orbit normal, along it, and between it and the track. None is more than
47 deg from one of them, so that two thirds of a burn or more act in the direction that is needed."""


def safe_delta_v(
    drift: Drift,
    planned_H: Vector,
    greatest: Scalar,
    may_wait: Flag,
    improves: bool = False,
    near_sigma: Scalar | None = None,
) -> Vector:
    """Velocity change [m/s] of the next burn: as much of the planned one as is safe, else the smallest that is safe.

    If nothing is safe, the burn with the greatest clearance is made; if no burn has clearance, the best one by the
    estimate alone. A planned change that is not finite is returned.
    A servicer that may wait makes no other burn while the drift is safe by the estimate alone: to know more is better
    than to leave a safe orbit for an uncertain one.

    Args:
        drift: free motion before the burn, and what it must keep clear of
        planned_H: (3,) velocity change by the control law; zero if there is none to be made [m/s]
        greatest: () size of the greatest change that can be made in any direction [m/s]
        may_wait: () bool, whether the estimate will be better at the next decision, and soon enough
        improves: whether a planned change counts as safe, too, that is nearly clear and clearer than no burn
        near_sigma: () for a servicer that comes within metres of the zone, execution error of the burn over its size
            per axis, 1 sigma, that is covered, too [-]; None elsewhere, where the zone is larger than that matters
    """
    tried = _Tried(planned_H=planned_H, greatest=greatest, may_wait=may_wait, improves=improves)

    def clearances(direction_H: Float[Array, "3 1"], sizes: Float[Array, "1 k"]) -> _Clearances:
        if near_sigma is None:
            return _of_direction(least_clearance(drift, direction_H, sizes))
        executed = gradient_safe.norm(direction_H[:, 0]) * sizes[0] * near_sigma
        return _of_direction(jax.vmap(partial(_near_clearance, drift, direction_H), -1, -1)(sizes, executed))

    return _chosen(_searched(tried, clearances, lambda found: found), tried)


def _near_clearance(
    drift: Drift, direction_H: Float[Array, "3 1"], size: Float[Array, "1"], executed: Scalar
) -> tuple[Float[Array, "1"], Float[Array, "1"]]:
    """Clearance of one burn that adds an uncertainty per axis [m/s] to the velocity, and that by the estimate alone."""
    is_velocity = jnp.arange(6) >= 3
    added = jnp.diag(jnp.where(is_velocity, executed * executed, 0.0))
    uncertain = replace(drift, covariance_H=drift.covariance_H + added)
    found = least_clearance(uncertain, direction_H, size[:, None], near=NEAR_SAMPLES)
    return found[0][:, 0], found[1][:, 0]


Clearance = Callable[[Float[Array, "3 d"], Float[Array, "d k"]], tuple[Float[Array, "n d k"], Float[Array, "n d k"]]]
"""Clearance from several others of burns in some directions and sizes, and that by the estimate alone."""


@pytree
class SafeBurn:
    """Burn that keeps clear of the target and of others.

    Attributes:
        delta_v_H: (3,) [m/s]
        changed_for: () int32, number of the one without which it would be another burn, -1 without one
    """

    delta_v_H: Array
    changed_for: Array


def safe_delta_v_among(
    drift: Drift, others: Clearance, planned_H: Vector, greatest: Scalar, may_wait: Flag
) -> SafeBurn:
    """Burn as by `safe_delta_v` that keeps clear of others, too; who they are is their number along the first axis."""
    tried = _Tried(planned_H=planned_H, greatest=greatest, may_wait=may_wait)

    def clearances(
        direction_H: Float[Array, "3 1"], sizes: Float[Array, "1 k"]
    ) -> tuple[_Clearances, _Clearances, Array]:
        own, theirs = least_clearance(drift, direction_H, sizes), others(direction_H, sizes)
        least = [jnp.minimum(alone, jnp.min(among, axis=0)) for alone, among in zip(own, theirs, strict=True)]
        return _of_direction(own), _of_direction(least), theirs[0][:, 0, 0]

    alone, together, from_each = _searched(tried, clearances, lambda found: found[1])
    delta_v_H = _chosen(together, tried)
    # The planned burn as a whole, which is the first one, leads nearest to whom it is changed for.
    nearest = jnp.argmin(from_each[0], axis=0).astype(jnp.int32)
    is_other = jnp.any(jnp.abs(delta_v_H - _chosen(alone, tried)) > 0.0, axis=0)
    return SafeBurn(delta_v_H=delta_v_H, changed_for=jnp.where(is_other, nearest, -1).astype(jnp.int32))


@dataclass(frozen=True)
class _Tried:
    """Burns that are tried, in one direction after the other: parts of the planned one first, then others.

    Attributes:
        planned_H: (3,) [m/s]
        greatest: () size of the greatest other one [m/s]
        may_wait: () bool, whether none is made while the drift is safe by the estimate alone
        improves: whether a planned one counts as safe, too, that is nearly clear and clearer than no burn
    """

    planned_H: Array
    greatest: Array
    may_wait: Array
    improves: bool = False

    @property
    def other_directions_H(self) -> Float[Array, "d 3"]:
        """Directions of the others."""
        return jnp.asarray(_DIRECTIONS, dtype=self.planned_H.dtype)

    @property
    def other_sizes(self) -> Float[Array, "d k"]:
        """Sizes of the others [m/s]."""
        sizes = jnp.asarray(_SIZES, dtype=self.planned_H.dtype) * self.greatest
        return jnp.broadcast_to(sizes, (len(_DIRECTIONS), len(_SIZES)))


@pytree
class _Clearances:
    """Clearances of burns in a direction, or in several.

    Attributes:
        certain: (..., k) with the uncertainty of the estimate [-]
        by_estimate: (..., k) by the estimate alone [-]
    """

    certain: Array
    by_estimate: Array


def _of_direction(clearances: Sequence[Float[Array, "1 k"]]) -> _Clearances:
    """Those of one direction alone."""
    return _Clearances(certain=clearances[0][0], by_estimate=clearances[1][0])


def _searched(tried: _Tried, evaluate: Callable[[Array, Array], Any], judged: Callable[[Any], _Clearances]) -> Any:
    """What `evaluate` gives for all directions, along the first axis; zeros for the others where none is needed.

    No other is needed where some part of the planned burn, or none, is made by the clearances that are `judged`.
    """
    shares = jnp.asarray(_SHARES, dtype=tried.planned_H.dtype)
    directions_H = jnp.concatenate([tried.planned_H[None], tried.other_directions_H])
    sizes = jnp.concatenate([shares[None], tried.other_sizes])
    shape = jax.eval_shape(evaluate, directions_H[:1].T, sizes[:1])

    def evaluated(needed: Flag, burn: tuple[Vector, Float[Array, " k"], Flag]) -> tuple[Flag, Any]:
        direction_H, sizes, is_planned = burn
        # Equal for all runs of a batch, so that it stays a branch: most decisions need no other burn.
        found = jax.lax.cond(
            any_of_batch(needed),
            lambda: evaluate(direction_H[:, None], sizes[None]),
            lambda: jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shape),
        )
        return jnp.where(is_planned, ~_of_planned(judged(found), tried)[1], needed), found

    # A scan: the planned burn by itself and the others together would take twice as long to compile.
    burns = (directions_H, sizes, jnp.arange(len(directions_H)) == 0)
    return jax.lax.scan(evaluated, jnp.ones((), dtype=bool), burns)[1]


def _chosen(clearances: _Clearances, tried: _Tried) -> Vector:
    """The burn [m/s] by the clearances of all of them."""
    chosen, is_found = _of_planned(jax.tree.map(lambda leaf: leaf[0], clearances), tried)
    return jnp.where(is_found, chosen, _of_others(jax.tree.map(lambda leaf: leaf[1:], clearances), tried))


def _of_planned(clearances: _Clearances, tried: _Tried) -> tuple[Vector, Flag]:
    """As much of the planned burn [m/s] as is safe, and whether any of it may be made, or none at all."""
    chosen, is_found = jnp.zeros_like(tried.planned_H), tried.may_wait & (clearances.by_estimate[_NO_BURN] >= 1.0)
    for number in reversed(range(len(_SHARES))):
        clearance, without = clearances.certain[number], clearances.certain[_NO_BURN]
        is_safe = clearance >= 1.0
        if tried.improves:
            is_safe |= (clearance >= _NEARLY_CLEAR) & (clearance > without)
        chosen, is_found = jnp.where(is_safe, _SHARES[number] * tried.planned_H, chosen), is_found | is_safe
    is_finite = gradient_safe.is_finite(tried.planned_H)
    return jnp.where(is_finite, chosen, tried.planned_H), is_found | ~is_finite


def _of_others(clearances: _Clearances, tried: _Tried) -> Vector:
    """The smallest of the other burns that is safe, else the one with the greatest clearance [m/s].

    That by the estimate alone counts where no other is left.
    """
    sizes, certain, by_estimate = tried.other_sizes, clearances.certain, clearances.by_estimate
    is_safe = certain >= 1.0
    # Of two burns of one size, the one with more clearance.
    cost = sizes / tried.greatest - _CLEARANCE_WEIGHT * certain / (1.0 + certain)
    cheapest = _least(jnp.where(is_safe, cost, jnp.inf))
    widest = _least(-certain - _ESTIMATE_WEIGHT * by_estimate / (1.0 + by_estimate))
    best = jnp.where(jnp.any(is_safe, axis=(0, 1)), cheapest, widest)
    made = jnp.where(best, sizes, 0.0)
    return jnp.sum(tried.other_directions_H[:, None, :] * made[:, :, None], axis=(0, 1))


def _least(cost: Float[Array, "d k"]) -> Bool[Array, "d k"]:
    """True for the burn with the least cost alone; of equal ones, for the first."""
    is_least = cost <= jnp.min(cost, axis=(0, 1))
    number = jnp.arange(cost.size).reshape(cost.shape)
    return number == jnp.min(jnp.where(is_least, number, cost.size), axis=(0, 1))
