"""Control effort against prediction: the velocity that the next burns must undo, as the last one was not as believed.

The estimate learns it from the measurements between two burns, as the sum of its velocity corrections. Those of an
optimal filter are uncorrelated in time, and the covariance of each is the decrease of the estimate's own (Bar-Shalom,
Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.2). So the expected
square of the sum is known.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from rpojax.core.pytree import pytree
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Flag = Bool[Array, ""]

BURNS = 10.0
"""Burns over which the ratio of squares is averaged, with fading memory [-]. A choice: `inspection` alarms at a ratio
of 6.7, with half or twice as many at 9.6 or 5.1; what it finds is in experiments/unseen_missions."""
DEGREES_OF_FREEDOM = 4.0 * BURNS
"""Of that mean: a fading one with a gain of 1 / b averages 2 b - 1 values, and two for each, as the velocity along the
line of sight is hardly measured [-]."""


@pytree
class ControlEffort:
    """Velocity corrections since the last burn, and their fading mean square over the burns before it.

    Attributes:
        correction: (3,) sum of the velocity corrections in N since the last burn began [m/s]
        variance: () expected square of its size [m^2/s^2]
        ratio: () fading mean of the square over the expected one, of the intervals between burns [-]
    """

    correction: Array
    variance: Array
    ratio: Array


def initial() -> ControlEffort:
    """No corrections, and the expected ratio."""
    zero = jnp.zeros(())
    return ControlEffort(correction=jnp.zeros(3), variance=zero, ratio=jnp.ones_like(zero))


def update(
    effort: ControlEffort, prior: RelativeEstimate, estimate: RelativeEstimate, burn_begins: Flag, inflated: Flag
) -> ControlEffort:
    """Control effort after the measurements of a tick turned the `prior` into the `estimate`.

    An interval between burns in which the covariance was `inflated`, or without measurements, is not counted.
    """
    change = prior.covariance - estimate.covariance
    known = effort.variance > 0.0
    square = jnp.sum(effort.correction * effort.correction, axis=0) / jnp.where(known, effort.variance, 1.0)
    ratio = effort.ratio + jnp.where(burn_begins & known, (square - effort.ratio) / BURNS, 0.0)
    keep = jnp.where(burn_begins | inflated, 0.0, 1.0)
    gain = jnp.where(inflated, 0.0, 1.0)
    return ControlEffort(
        correction=keep * effort.correction + gain * (estimate.v_TS_N - prior.v_TS_N),
        variance=keep * effort.variance + gain * (change[3, 3] + change[4, 4] + change[5, 5]),
        ratio=ratio,
    )
