"""Burn veto and abort burn: the velocity change whose free drift stays clear of the keep-out zone, and of others."""

import itertools
import math
from collections.abc import Callable
from typing import Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.mission.drift_clearance import Drift, least_clearance

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]

_SHARES: Final = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Parts of the planned burn that are tried, the first safe one is taken [-]."""

_NO_BURN: Final = (0, len(_SHARES) - 1)
"""Place of no burn among those that are tried."""

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
    burns = _burns(planned_H, greatest)
    clearance, by_estimate = least_clearance(drift, burns.directions_H, burns.sizes)
    return _chosen(burns, clearance, by_estimate, greatest, may_wait)


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
    burns = _burns(planned_H, greatest)
    clearance, by_estimate = least_clearance(drift, burns.directions_H, burns.sizes)
    of_others, of_others_by_estimate = others(burns.directions_H, burns.sizes)
    alone = _chosen(burns, clearance, by_estimate, greatest, may_wait)
    together = jnp.minimum(clearance, jnp.min(of_others, axis=0))
    by_estimate = jnp.minimum(by_estimate, jnp.min(of_others_by_estimate, axis=0))
    delta_v_H = _chosen(burns, together, by_estimate, greatest, may_wait)
    # The planned burn as a whole, which is the first one, leads nearest to whom it is changed for.
    nearest = jnp.argmin(of_others[:, 0, 0], axis=0).astype(jnp.int32)
    is_other = jnp.any(jnp.abs(delta_v_H - alone) > 0.0, axis=0)
    return SafeBurn(delta_v_H=delta_v_H, changed_for=jnp.where(is_other, nearest, -1).astype(jnp.int32))


@pytree
class _Burns:
    """Burns that are tried: the planned one first, then the others.

    Attributes:
        planned_H: (3,) [m/s]
        others_H: (3, d - 1) directions of the others
        other_sizes: (d - 1, k) sizes of the others [m/s]
        directions_H: (3, d) of all
        sizes: (d, k) factors on each direction
    """

    planned_H: Array
    others_H: Array
    other_sizes: Array
    directions_H: Array
    sizes: Array


def _burns(planned_H: Vector, greatest: Scalar) -> _Burns:
    dtype = planned_H.dtype
    others_H = jnp.asarray(_DIRECTIONS.T, dtype=dtype)
    directions_H = jnp.concatenate([planned_H[:, None], others_H], axis=1)
    sizes = jnp.broadcast_to(jnp.asarray(_SIZES, dtype=dtype) * greatest, (len(_DIRECTIONS), len(_SIZES)))
    shares = jnp.asarray(_SHARES, dtype=dtype)[None]
    return _Burns(
        planned_H=planned_H,
        others_H=others_H,
        other_sizes=sizes,
        directions_H=directions_H,
        sizes=jnp.concatenate([shares, sizes]),
    )


def _chosen(
    burns: _Burns,
    clearance: Float[Array, "d k"],
    by_estimate: Float[Array, "d k"],
    greatest: Scalar,
    may_wait: Flag,
) -> Vector:
    """The burn [m/s] by the clearance of all of them, that by the estimate alone counts where no other is left."""
    of_planned, of_others = clearance[0], clearance[1:]
    others_H, sizes, planned_H = burns.others_H, burns.other_sizes, burns.planned_H
    is_safe = of_others >= 1.0
    # Of two burns of one size, the one with more clearance.
    cheapest = _least(jnp.where(is_safe, sizes / greatest - 0.01 * of_others / (1.0 + of_others), jnp.inf))
    widest = _least(-of_others - _ESTIMATE_WEIGHT * by_estimate[1:] / (1.0 + by_estimate[1:]))
    best = jnp.where(jnp.any(is_safe, axis=(0, 1)), cheapest, widest)
    chosen = jnp.sum(others_H[:, :, None] * jnp.where(best, sizes, 0.0)[None], axis=(1, 2))
    chosen = jnp.where(may_wait & (by_estimate[_NO_BURN] >= 1.0), 0.0, chosen)
    for number in reversed(range(len(_SHARES))):
        chosen = jnp.where(of_planned[number] >= 1.0, _SHARES[number] * planned_H, chosen)
    return jnp.where(gradient_safe.is_finite(planned_H), chosen, planned_H)


def _least(cost: Float[Array, "d k"]) -> Bool[Array, "d k"]:
    """True for the burn with the least cost alone; of equal ones, for the first."""
    is_least = cost <= jnp.min(cost, axis=(0, 1))
    number = jnp.arange(cost.size).reshape(cost.shape)
    return number == jnp.min(jnp.where(is_least, number, cost.size), axis=(0, 1))
