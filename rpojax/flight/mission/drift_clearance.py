"""Clearance of free drifts from a keep-out ellipsoid over many orbits, with the uncertainty of the estimate.

The free motion of the linear model repeats itself from orbit to orbit but for a drift that is proportional to time. So
the passages of one place on the orbit lie on a straight line, and the samples of one orbit cover any horizon: each by
the least distance of the line from its first passage to its last. Between samples it is that of parabolas through the
squares of three of them. The start, where the servicer is whatever it burns, counts only as one of the three. The
uncertainty of the estimate covers the whole covariance of the state at the first passages; up to the last ones, the
scale of the motion and its drift. Metres from the zone the first and the last interval are sampled more finely, and the
line begins an orbit later: from the first passage it would lead through the target where the servicer does not.
"""

import itertools
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import cross

Scalar = Float[Array, ""]


@pytree
class Drift:
    """What free drifts after a burn have in common.

    Attributes:
        orbit: of the target at the burn
        state_H: (6,) relative state before the burn [m, m/s]
        scale_sigma: () 1-sigma of the range over the range, which scales the whole relative motion [-]
        covariance_H: (6, 6) of that state
        sigmas: () of these that are covered [-]
        semi_axes: (3,) of the keep-out ellipsoid in H with its margin [m]
        first_span: () free motion that is sampled [s]
        horizon: () end of the drift, at least the span [s]
    """

    orbit: TargetOrbit
    state_H: Array
    scale_sigma: Array
    covariance_H: Array
    sigmas: Array
    semi_axes: Array
    first_span: Array
    horizon: Array


def orbit_period(orbit: TargetOrbit) -> Scalar:
    """Period of an orbit [s]."""
    return 2.0 * math.pi / mean_motion(orbit.semi_major_axis)


_SAMPLES = 28
"""Times of the first span [-]. With the parabola between them, drifts of up to 50 m an orbit come nearer than found by
0.2 m at p95 on a circular orbit, by 0.9 m at e = 0.7; `mission.abort_margin_m` adds 2 m."""


NEAR_SAMPLES = 14
"""Times within the first and the last interval of these, for drifts that begin metres from their zone [-]: 15 s apart,
in which a burn of 0.1 m/s leads 1.5 m away. The parabola over intervals of 200 s knows nothing of such a start."""


def least_clearance(
    drift: Drift,
    directions_H: Float[Array, "3 d"],
    sizes: Float[Array, "d k"],
    samples: int = _SAMPLES,
    near: int = 0,
) -> tuple[Float[Array, "d k"], Float[Array, "d k"]]:
    """Least distance from the target over that of the keep-out ellipsoid in the same direction.

    Returned are that of each burn with the uncertainty of the estimate, and by the estimate alone.

    Args:
        drift: what the drifts have in common
        directions_H: (3, d) directions of burns, of any length
        sizes: (d, k) factors on each direction [m/s]
        samples: number of times of the first span after its start, evenly spaced in eccentric anomaly
        near: 0, or for a drift that begins metres from the zone, number of times in the first and the last of these
            intervals; the passages that lie on a line are then those from the second one on
    """
    # A zone of no size, of which every point is clear, has no direction.
    drift = replace(drift, semi_axes=jnp.maximum(drift.semi_axes, LEAST_SEMI_AXIS))
    columns = jnp.concatenate([jnp.zeros_like(directions_H), directions_H])
    columns = jnp.concatenate([columns, drift.state_H[:, None], jnp.eye(6, dtype=drift.state_H.dtype)], axis=1)
    constants = yamanaka_ankersen.constants_of_motion(drift.orbit, columns)
    constants, of_states = constants[:, :-6], constants[:, -6:]
    unit_drift = jnp.where(jnp.arange(6)[:, None] == 3, 1.0, jnp.zeros_like(constants[:, :1]))
    constants = jnp.concatenate([constants, unit_drift], axis=1)
    scale_error, drift_error = drift.sigmas * drift.scale_sigma, drift.sigmas * _drift_sigma(drift, of_states[3])
    later = drift.horizon - drift.first_span
    ends = jnp.stack([jnp.zeros_like(later), *([jnp.minimum(drift.first_span, later)] if near else []), later])

    def square_distances(time: Scalar) -> Float[Array, "6 d k"]:
        place = yamanaka_ankersen.advanced(drift.orbit, time)

        def passage(_: None, later: Scalar) -> tuple[None, Float[Array, "3 c"]]:
            moved = yamanaka_ankersen.free_motion(place, time + later, constants)[:3]
            return None, moved / drift.semi_axes[:, None]

        passages = jax.lax.scan(passage, None, ends)[1]
        first, begin, last = passages[0], passages[-2], passages[-1]
        a, b = (each[:, :-2, None] * sizes[None] for each in (begin, last))
        transition = yamanaka_ankersen.free_motion(place, time, of_states)[:3] / drift.semi_axes[:, None]
        at_first = first[:, :-2, None] * sizes[None] + first[:, -2][:, None, None]
        found = [_certain_square_distance(at_first, drift, transition)]
        for scale, other in itertools.product((-1.0, 1.0), repeat=2):
            # The covariance covers the first passages; metres from the zone the drift constant moves them too far.
            drifted = [each[:, -1] - first[:, -1] if near else each[:, -1] for each in (begin, last)]
            base = [
                (1.0 + scale * scale_error) * each[:, -2] + other * drift_error * moved
                for each, moved in zip((begin, last), drifted, strict=True)
            ]
            found.append(_square_distance_to_line(a + base[0][:, None, None], b + base[1][:, None, None]))
        estimated = _square_distance_to_line(a + begin[:, -2][:, None, None], b + last[:, -2][:, None, None])
        if near:
            estimated = jnp.minimum(estimated, jnp.sum(at_first * at_first, axis=0))
        found.append(estimated)
        return jnp.stack(found)

    least = _least_over(
        square_distances, _parts_of_span(drift, samples, near), jnp.full((6, *sizes.shape), jnp.inf, dtype=sizes.dtype)
    )
    return gradient_safe.sqrt(jnp.min(least[:-1], axis=0)), gradient_safe.sqrt(least[-1])


def _parts_of_span(drift: Drift, samples: int, near: int) -> list[Array]:
    """Times of the first span [s] in parts evenly spaced in eccentric anomaly, each from the end of the last one on."""
    edge, parts = 1.0 / samples, [(0.0, 1.0, samples)]
    if near:
        parts = [(0.0, edge, near), (edge, 1.0 - edge, samples - 2), (1.0 - edge, 1.0, near)]
    return [
        yamanaka_ankersen.times_of_even_eccentric_anomalies(
            drift.orbit, drift.first_span, jnp.linspace(begin, end, number + 1, dtype=drift.state_H.dtype)
        )
        for begin, end, number in parts
    ]


def _least_over(
    square_distances: Callable[[Scalar], Float[Array, "n d k"]],
    times: Sequence[Array],
    none: Float[Array, "n d k"],
) -> Float[Array, "n d k"]:
    """Least value of a function of time at `times` but the first and between them; `none` is infinite.

    They are in parts that are evenly spaced, each from the end of the one before it on.
    """

    def sample(
        before: tuple[Array, Array, Array], at: tuple[Scalar, Array, Scalar, Scalar]
    ) -> tuple[tuple[Array, Array, Array], None]:
        least, earlier, middle = before
        time, is_start, low, high = at
        later = square_distances(time)
        at_vertex = _least_between(earlier, middle, later, low, high)
        least = jnp.minimum(jnp.minimum(least, jnp.where(is_start, jnp.inf, later)), at_vertex)
        return (least, middle, later), None

    def within(part: Float[Array, " t"]) -> tuple[Array, Array, Array, Array]:
        last = part.shape[0] - 1
        number = jnp.arange(last + 1)
        # A vertex belongs to the sample nearest to it; those beside the start and the end, to the triples there.
        low = jnp.where(number > 2, -0.5, jnp.where(number == 2, -1.0, jnp.inf)).astype(part.dtype)
        high = jnp.where(number == last, 1.0, 0.5).astype(part.dtype)
        return part, number == 0, low, high

    zero = jnp.zeros_like(none)
    samples = jax.tree.map(lambda *each: jnp.concatenate(each), *map(within, times))
    return jax.lax.scan(sample, (none, zero, zero), samples)[0][0]


def _least_between(
    earlier: Float[Array, "n d k"],
    middle: Float[Array, "n d k"],
    later: Float[Array, "n d k"],
    low: Scalar,
    high: Scalar,
) -> Float[Array, "n d k"]:
    """Value at the vertex of the parabola through three even samples, infinite where there is no least one.

    The vertex counts between `low` and `high`, in steps from the middle sample.
    """
    curvature, rise = earlier - 2.0 * middle + later, later - earlier
    is_convex = curvature > 0.0
    place = -0.5 * rise / jnp.where(is_convex, curvature, 1.0)
    counts = is_convex & (place >= low) & (place <= high)
    return jnp.where(counts, jnp.maximum(middle + 0.25 * place * rise, 0.0), jnp.inf)


LEAST_SEMI_AXIS = 1e-3
"""Semi-axis of a keep-out ellipsoid that is divided by, at least [m]: far below any error."""


def _drift_sigma(drift: Drift, row: Float[Array, "6"]) -> Scalar:
    """1-sigma of the drift constant [m], a linear function of the state."""
    return gradient_safe.sqrt(jnp.sum(row * jnp.sum(drift.covariance_H * row[None], axis=1), axis=0))


def _certain_square_distance(
    place: Float[Array, "3 d k"], drift: Drift, transition: Float[Array, "3 6"]
) -> Float[Array, "d k"]:
    """Squared distance from the origin that is left in the worst case of the state before, in the scale of the zone.

    The distance is at least that along any direction. The one that is taken avoids those of great uncertainty: with E
    the covariance of the place times the squared sigmas it is u = adj(E + I) p, for which E u = det(E + I) p - u.
    """
    half = jnp.sum(transition[:, :, None] * drift.covariance_H[None], axis=1)
    errors = drift.sigmas * drift.sigmas * jnp.sum(half[:, None] * transition[None], axis=2)
    x, y, z = errors + jnp.eye(3, dtype=errors.dtype)
    adjugate = jnp.stack([cross(y, z), cross(z, x), cross(x, y)])
    determinant = jnp.sum(x * adjugate[0], axis=0)
    u = jnp.sum(adjugate[:, :, None, None] * place[None], axis=1)
    along, square = jnp.sum(u * place, axis=0), jnp.sum(u * u, axis=0)
    uncertain = gradient_safe.sqrt(jnp.maximum(determinant * along - square, 0.0))
    certain = jnp.maximum(along - uncertain, 0.0)
    return certain * certain / jnp.where(square > 0.0, square, 1.0)


def _square_distance_to_line(a: Float[Array, "3 d k"], b: Float[Array, "3 d k"]) -> Float[Array, "d k"]:
    """Squared distance from the origin to the line from `a` to `b`."""
    along = b - a
    square = jnp.sum(along * along, axis=0)
    share = -jnp.sum(a * along, axis=0) / jnp.where(square > 0.0, square, 1.0)
    nearest = a + jnp.clip(share, 0.0, 1.0)[None, :] * along
    return jnp.sum(nearest * nearest, axis=0)
