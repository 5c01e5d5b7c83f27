"""Correlation time of the apparent outline, which falls as the target tumbles faster, from the aspect ratio of boxes.

The aspect ratio varies with the target's attitude as the size does, but not with the range. Two first-order low-pass
filters of its log follow it; the ratio of the mean squares of what they leave tells its correlation time, as for a
Gauss-Markov process, where a filter of time constant T leaves T / (T + tau) of the variance.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree, replace

Scalar = Float[Array, ""]

_FILTER_TIMES = (30.0, 300.0)
"""Time constants of the low-pass filters [s]: a tenth of a slow tumble, and that tumble of 1.2 deg/s."""
_AVERAGING_TIME = 1500.0
"""Time over which the mean squares forget [s]. A choice: five of the longer filter's times."""
_PRIOR_VARIANCE = 0.2
"""Variance of the log aspect ratio of a compact spacecraft with panels: 0.23 of the packaged hull."""
_PRIOR_TIME = 100.0
"""Time for which the prior counts [s]. A choice: a fifteenth of that of the measured squares."""
_PRIOR_CORRELATION_TIME = 300.0
"""Correlation time before any box [s]: that of the slow tumble, cautious, since an outline that stays the same says
least about the range."""
_CORRELATION_TIMES = (3.0, 5000.0)
"""Limits of the correlation time [s]: a frame or two, and nearly a low orbit, in which the line of sight turns once."""
_LEAST_ENERGY_SHARE = 1e-3
"""Least mean squares over the prior [-]: deducted noise must not leave a negative one, and they are divided by."""
NEVER = 1e6
"""Age of a box before the first [s]: far above all times of the filters, and a number."""


@pytree
class OutlineCorrelation:
    """Filtered log aspect ratio of the boxes.

    Attributes:
        smoothed: (2,) log aspect ratio after the low-pass filters [-]
        energy: (2,) integral of the squares of what they leave, noise deducted [s]
        age: () since the last box [s], very long before the first
    """

    smoothed: Array
    energy: Array
    age: Array


def initial() -> OutlineCorrelation:
    """State before the first box."""
    times = jnp.array(_FILTER_TIMES)
    return OutlineCorrelation(smoothed=jnp.zeros(2), energy=_prior_energy(times), age=jnp.full((), NEVER))


def _prior_energy(times: Float[Array, "2"]) -> Float[Array, "2"]:
    return _PRIOR_TIME * _PRIOR_VARIANCE * times / (times + _PRIOR_CORRELATION_TIME)


def elapse(state: OutlineCorrelation, dt: float) -> OutlineCorrelation:
    """State `dt` [s] later."""
    return replace(state, age=state.age + dt)


def update(
    state: OutlineCorrelation, log_aspect: Scalar, noise_variance: Scalar, used: Bool[Array, ""]
) -> OutlineCorrelation:
    """State after a box with the log of width over height, whose noise has that variance, if it is `used`."""
    times = jnp.array(_FILTER_TIMES, dtype=log_aspect.dtype)
    kept = jnp.exp(-state.age / times)
    left = log_aspect - state.smoothed
    # A long gap says little about what changed within a filter's time.
    weight = state.age * kept[0]
    forgotten, prior = jnp.exp(-weight / _AVERAGING_TIME), _prior_energy(times)
    # The noise that the filters pass adds to that of the box.
    noise = noise_variance * 2.0 / (1.0 + kept)
    # What is forgotten is replaced by the prior: an outline without change has no mean squares of its own.
    energy = prior + forgotten * (state.energy - prior) + weight * (left**2 - noise)
    floor = _LEAST_ENERGY_SHARE * _PRIOR_TIME * _PRIOR_VARIANCE
    return OutlineCorrelation(
        smoothed=jnp.where(used, log_aspect - kept * left, state.smoothed),
        energy=jnp.where(used, jnp.maximum(energy, floor), state.energy),
        age=jnp.where(used, 0.0, state.age),
    )


def correlation_time(state: OutlineCorrelation) -> Scalar:
    """Correlation time of the outline [s]."""
    short, long = _FILTER_TIMES
    shortest, longest = _CORRELATION_TIMES
    ratio = state.energy[0] / state.energy[1]
    # The ratio falls from 1 at zero to that of the filters' times at infinity. Half of the excess there is its bound.
    excess = jnp.maximum(ratio * long - short, short * (long - short) / (longest + short) * 0.5)
    return jnp.clip(short * long * (1.0 - ratio) / excess, shortest, longest)
