"""Burn veto and abort burn: the velocity change whose free drift stays clear of the keep-out zone, and of others."""

import itertools
import math
from collections.abc import Callable
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.mission.drift_clearance import Drift, least_clearance

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]

_SHARES: Final = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Parts of the planned burn that are tried, the first safe one is taken [-]."""

_NO_BURN: Final = len(_SHARES) - 1
"""Place of no burn among these."""

_ESTIMATE_WEIGHT: Final = 1e-3
"""Weight of the clearance by the estimate alone, which decides where none is left with its uncertainty [-]."""

_SIZES: Final = (0.05, 0.12, 0.3, 0.6, 1.0)
"""Sizes of other burns over the greatest that can be made in any direction [-]."""

_R: Final = math.sqrt(0.5)
_DIRECTIONS: Final = np.array(
    [
        *((math.cos(angle), math.sin(angle), 0.0) for angle in np.arange(8) * (math.pi / 4.0)),
        *((0.0, 0.0, sign) for sign in (1.0, -1.0)),
        *((0.0, _R * y, _R * z) for y, z in itertools.product((1.0, -1.0), repeat=2)),
    ]
)
"""Directions in H of other burns: all about the orbit normal, along it, and between it and the track."""


def safe_delta_v(drift: Drift, planned_H: Vector, greatest: Scalar, may_wait: Flag) -> Vector:
    """Velocity change [m/s] of the next burn: as much of the planned one as is safe, else the smallest that is safe.

    If nothing is safe, the one with the greatest clearance is made; of those without any, the best by the estimate
    alone. A planned change that is not finite is returned.
    A servicer that may wait makes no other burn while the drift is safe by the estimate alone: to know more is better
    than to leave a safe orbit for an uncertain one.

    Args:
        drift: free motion before the burn, and what it must keep clear of
        planned_H: (3,) velocity change by the control law; zero if there is none to be made [m/s]
        greatest: () size of the greatest change that can be made in any direction [m/s]
        may_wait: () bool, whether the estimate will be better at the next decision, and soon enough
    """
    chosen, is_found = _of_planned(_clearances(drift, planned_H[:, None], _shares(planned_H)), planned_H, may_wait)

    def other() -> Vector:
        return _of_others(_clearances(drift, *_others(planned_H, greatest)), planned_H, greatest)

    # Equal for all runs of a batch, so that it stays a branch: most decisions need no other burn.
    found = jax.lax.cond(any_of_batch(~is_found), other, lambda: chosen)
    return jnp.where(is_found, chosen, found)


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
    directions_H, sizes = _others(planned_H, greatest)
    planned, other = (planned_H[:, None], _shares(planned_H)), (directions_H, sizes)
    alone = [_clearances(drift, *burns) for burns in (planned, other)]
    among = [others(*burns) for burns in (planned, other)]
    together = [
        _Clearances(
            certain=jnp.minimum(own.certain, jnp.min(theirs[0], axis=0)),
            by_estimate=jnp.minimum(own.by_estimate, jnp.min(theirs[1], axis=0)),
        )
        for own, theirs in zip(alone, among, strict=True)
    ]

    def chosen(of_planned: _Clearances, of_others: _Clearances) -> Vector:
        delta_v_H, is_found = _of_planned(of_planned, planned_H, may_wait)
        return jnp.where(is_found, delta_v_H, _of_others(of_others, planned_H, greatest))

    delta_v_H = chosen(*together)
    # The planned burn as a whole, which is the first one, leads nearest to whom it is changed for.
    nearest = jnp.argmin(among[0][0][:, 0, 0], axis=0).astype(jnp.int32)
    is_other = jnp.any(jnp.abs(delta_v_H - chosen(*alone)) > 0.0, axis=0)
    return SafeBurn(delta_v_H=delta_v_H, changed_for=jnp.where(is_other, nearest, -1).astype(jnp.int32))


@pytree
class _Clearances:
    """Clearances of burns in some directions and sizes.

    Attributes:
        certain: (d, k) with the uncertainty of the estimate [-]
        by_estimate: (d, k) by the estimate alone [-]
    """

    certain: Array
    by_estimate: Array


def _clearances(drift: Drift, directions_H: Float[Array, "3 d"], sizes: Float[Array, "d k"]) -> _Clearances:
    certain, by_estimate = least_clearance(drift, directions_H, sizes)
    return _Clearances(certain=certain, by_estimate=by_estimate)


def _shares(planned_H: Vector) -> Float[Array, "1 k"]:
    """Parts of the planned burn that are tried."""
    return jnp.asarray(_SHARES, dtype=planned_H.dtype)[None]


def _others(planned_H: Vector, greatest: Scalar) -> tuple[Float[Array, "3 d"], Float[Array, "d k"]]:
    """Directions of the other burns that are tried, and their sizes [m/s]."""
    sizes = jnp.asarray(_SIZES, dtype=planned_H.dtype) * greatest
    return jnp.asarray(_DIRECTIONS.T, dtype=planned_H.dtype), jnp.broadcast_to(sizes, (len(_DIRECTIONS), len(_SIZES)))


def _of_planned(clearances: _Clearances, planned_H: Vector, may_wait: Flag) -> tuple[Vector, Flag]:
    """As much of the planned burn [m/s] as is safe, and whether any of it may be made, or none at all."""
    chosen, is_found = jnp.zeros_like(planned_H), may_wait & (clearances.by_estimate[0, _NO_BURN] >= 1.0)
    for number in reversed(range(len(_SHARES))):
        is_safe = clearances.certain[0, number] >= 1.0
        chosen, is_found = jnp.where(is_safe, _SHARES[number] * planned_H, chosen), is_found | is_safe
    is_finite = gradient_safe.is_finite(planned_H)
    return jnp.where(is_finite, chosen, planned_H), is_found | ~is_finite


def _of_others(clearances: _Clearances, planned_H: Vector, greatest: Scalar) -> Vector:
    """The smallest of the other burns that is safe, else the one with the greatest clearance [m/s].

    That by the estimate alone counts where no other is left.
    """
    directions_H, sizes = _others(planned_H, greatest)
    certain, by_estimate = clearances.certain, clearances.by_estimate
    is_safe = certain >= 1.0
    # Of two burns of one size, the one with more clearance.
    cheapest = _least(jnp.where(is_safe, sizes / greatest - 0.01 * certain / (1.0 + certain), jnp.inf))
    widest = _least(-certain - _ESTIMATE_WEIGHT * by_estimate / (1.0 + by_estimate))
    best = jnp.where(jnp.any(is_safe, axis=(0, 1)), cheapest, widest)
    return jnp.sum(directions_H[:, :, None] * jnp.where(best, sizes, 0.0)[None], axis=(1, 2))


def _least(cost: Float[Array, "d k"]) -> Bool[Array, "d k"]:
    """True for the burn with the least cost alone; of equal ones, for the first."""
    is_least = cost <= jnp.min(cost, axis=(0, 1))
    number = jnp.arange(cost.size).reshape(cost.shape)
    return number == jnp.min(jnp.where(is_least, number, cost.size), axis=(0, 1))
