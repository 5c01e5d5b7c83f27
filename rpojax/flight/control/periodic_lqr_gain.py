"""Gains of the linear-quadratic regulator for relative motion near an elliptic orbit, which repeats with each orbit."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import (
    TargetOrbit,
    advanced,
    mean_argument_of_latitude,
    transition_matrix,
)
from rpojax.flight.control.formation_tuning import FormationTuning

Matrix = Float[Array, "6 6"]
Gains = Float[Array, "n 3 6"]


def burns_per_orbit(period: float, control_period: float) -> int:
    """Number of burns for a table of gains: control periods [s] in a period of the orbit [s], rounded."""
    return max(round(period / control_period), _FEWEST_BURNS)


def tables_per_burn(eccentricity: float, burns: int) -> int:
    """Number of tables whose steps lie between one another's, so that gains midway between steps err by 2 % at most.

    One is enough for burns that are as frequent as their gains need it at the perigee; those of seldom burns vary more.
    """
    if burns >= _FREQUENT * (1.0 - eccentricity) ** -2.0:
        return 1
    return math.ceil(_FEWEST_STEPS * (1.0 - eccentricity) ** -2.6 / burns)


def periodic_lqr_gains(formation: FormationTuning, orbit: TargetOrbit, burns: int, tables: int = 1) -> Gains:
    """Gains at `burns * tables` equal steps of the mean argument of latitude from 0.

    Each is that of one impulse every `tables` steps. The weights count once per burn, as in `lqr_gain`, to which each
    gain is equal on a circular orbit. By backward recursion of the Riccati equation over some orbits, the first of
    which gives the gains. The impulses are independent, so that the minimisation is a sequence of scalar updates.
    """
    weights = jnp.diag(jnp.concatenate([formation.position_weight, formation.velocity_weight]))

    def earlier(cost: Matrix, motion: Matrix) -> tuple[Matrix, Float[Array, "3 6"]]:
        # From just before the next impulse to just after this one.
        cost = motion.T @ cost @ motion
        for axis in range(3):
            row = cost[3 + axis]
            cost = cost - row[:, None] * (row / (formation.delta_v_weight[axis] + row[3 + axis]))[None, :]
        return weights + 0.5 * (cost + cost.T), cost[3:] / formation.delta_v_weight[:, None]

    def table(_: None, first: Float[Array, ""]) -> tuple[None, Gains]:
        motions = _motions_between_burns(orbit, burns, first)

        def orbit_earlier(cost: Matrix, _: None) -> tuple[Matrix, None]:
            return jax.lax.scan(earlier, cost, motions, reverse=True)[0], None

        settled, _ = jax.lax.scan(orbit_earlier, weights, None, length=-(-_SETTLING_BURNS // burns))
        return None, jax.lax.scan(earlier, settled, motions, reverse=True)[1]

    starts = jnp.arange(tables, dtype=orbit.semi_major_axis.dtype) * (1.0 / tables)
    _, gains = jax.lax.scan(table, None, starts)
    return jnp.reshape(jnp.swapaxes(gains, 0, 1), (burns * tables, 3, 6))


def gain_at(gains: Gains, orbit: TargetOrbit) -> Float[Array, "3 6"]:
    """Gain at a place on the orbit, by linear interpolation in the mean argument of latitude.

    As a weighted sum over the table: in a batch each run has its own place. A table of one gain holds everywhere.
    """
    count = gains.shape[0]
    if count == 1:
        return gains[0]
    steps = jnp.arange(count, dtype=gains.dtype)
    place = mean_argument_of_latitude(orbit) * (count / (2.0 * math.pi))
    distance = place - steps
    distance = jnp.abs(distance - count * jnp.round(distance / count))
    return jnp.sum(jnp.maximum(1.0 - distance, 0.0)[:, None, None] * gains, axis=0)


def _motions_between_burns(orbit: TargetOrbit, burns: int, first: Float[Array, ""]) -> Float[Array, "n 6 6"]:
    """State transition matrices between burns at equal steps of the mean argument of latitude, from step `first` on."""
    n = mean_motion(orbit.semi_major_axis)
    start = advanced(orbit, -mean_argument_of_latitude(orbit) / n)
    interval = 2.0 * math.pi / (burns * n)

    def motion(_: None, step: Float[Array, ""]) -> tuple[None, Matrix]:
        return None, transition_matrix(advanced(start, (first + step) * interval), interval)

    return jax.lax.scan(motion, None, jnp.arange(burns, dtype=n.dtype))[1]


_FEWEST_BURNS = 8
"""Fewest burns per orbit of a table [-]: between two places gains are off by 0.3 % at e = 0.4, with half as many by 20
%; on more eccentric orbits several tables lie between each other."""
_FREQUENT = 14.0
"""Burns per orbit of a table that is enough by itself, over the ratio of semi-major axis and perigee squared [-]."""
_FEWEST_STEPS = 14.0
"""Fewest steps of several tables on an orbit, over that ratio to the power of 2.6 [-]."""


_SETTLING_BURNS = 150
"""Burns after which the recursion has forgotten its beginning [-]: to 1e-14 up to e = 0.7 with a `delta_v_weight` up to
a hundred times that of `inspection`, to 1e-8 with three thousand times; half as many leave 2e-5 there."""
