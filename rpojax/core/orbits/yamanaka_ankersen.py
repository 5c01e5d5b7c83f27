"""Relative motion near an elliptic orbit in the Hill frame.

Yamanaka and Ankersen, "New state transition matrix for relative motion on an arbitrary elliptical orbit", 2002, with
the argument of latitude u in place of the true anomaly, so that a circular orbit is no special case. The general
solution consists of six motions, each with its constant [m]: `free_motion` of the `constants_of_motion`.
With p the semi-latus rectum, kappa = p/r = 1 + ex cos u + ey sin u, kappa' = d kappa/du and tau the time from the epoch
divided by sqrt(p^3/mu):

    x = -ax cos u - ay sin u - d (2/kappa + 3 kappa' tau)
    y = y0/kappa + (1 + 1/kappa) (ax sin u - ay cos u) + 3 d kappa tau
    z = (bx sin u - by cos u) / kappa

y0, (ax, ay) and (bx, by) are closed relative orbits, d is a drift along the velocity of the target.
"""

from typing import Final

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rpojax.core.constants import MU_EARTH
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2, cos_sin
from rpojax.core.orbits.keplerian_elements import mean_motion, semi_major_axis
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import cross

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Columns = Float[Array, "6 *columns"]


@pytree
class TargetOrbit:
    """Place on an osculating elliptic orbit, in non-singular elements.

    Attributes:
        argument_of_latitude: () u, from the reference direction in the orbit plane to the position [rad]
        ex: () component of the eccentricity vector along the reference direction [-]
        ey: () component 90 deg ahead of it [-]
        semi_major_axis: () [m]
    """

    argument_of_latitude: Array
    ex: Array
    ey: Array
    semi_major_axis: Array


def target_orbit(r_N: Vector, v_N: Vector) -> TargetOrbit:
    """Orbit of an inertial position [m] and velocity [m/s].

    The reference direction is the ascending node. An orbit inclined by less than 0.06 deg to the equator, whose node is
    ill-defined, takes N's x axis projected into its plane.
    """
    momentum = cross(r_N, v_N)
    normal = gradient_safe.normalize(momentum)
    x, y, z = normal
    inclined = x * x + y * y > _LEAST_NODE_SINE**2
    node = jnp.stack([-y, x, jnp.zeros_like(x)])
    projected = jnp.stack([1.0 - x * x, -x * y, -x * z])
    reference = gradient_safe.normalize(jnp.where(inclined, node, projected))
    ahead = cross(normal, reference)
    perigee = cross(v_N, momentum) / MU_EARTH - gradient_safe.normalize(r_N)
    return TargetOrbit(
        argument_of_latitude=arctan2(jnp.sum(r_N * ahead, axis=0), jnp.sum(r_N * reference, axis=0)),
        ex=jnp.sum(perigee * reference, axis=0),
        ey=jnp.sum(perigee * ahead, axis=0),
        semi_major_axis=semi_major_axis(r_N, v_N),
    )


def advanced(orbit: TargetOrbit, dt: Scalar) -> TargetOrbit:
    """Orbit `dt` [s] later or, if negative, earlier; u counts whole turns on.

    Kepler's equation is solved for the change of the eccentric argument of latitude, for eccentricities up to 0.9.
    """
    e_cos, e_sin = _eccentric_anomaly(orbit)
    change = _eccentric_change(e_cos, e_sin, mean_motion(orbit.semi_major_axis) * dt)
    c, s = cos_sin(change)
    after_cos, after_sin, one = e_cos * c - e_sin * s, e_sin * c + e_cos * s, 1.0 + _eta(orbit)
    # Difference of the halves of true less eccentric anomaly, whose tangents are e sin E / (1 + eta - e cos E).
    sine = after_sin * (one - e_cos) - e_sin * (one - after_cos)
    half = arctan2(sine, (one - after_cos) * (one - e_cos) + after_sin * e_sin)
    return replace(orbit, argument_of_latitude=orbit.argument_of_latitude + change + 2.0 * half)


def times_of_even_eccentric_anomalies(
    orbit: TargetOrbit, span: Scalar, shares: Float[Array, " shares"]
) -> Float[Array, " shares"]:
    """Times [s] within a `span` [s] at which these shares of its change of eccentric anomaly have passed.

    Steps of time are proportional to the distance from the Earth: the relative motion is fast near perigee.
    """
    e_cos, e_sin = _eccentric_anomaly(orbit)
    n = mean_motion(orbit.semi_major_axis)
    change = shares * _eccentric_change(e_cos, e_sin, n * span)
    c, s = cos_sin(change)
    return (change - e_sin * c - e_cos * s + e_sin) / n


def mean_argument_of_latitude(orbit: TargetOrbit) -> Scalar:
    """Argument of latitude of the perigee plus the mean anomaly [rad], which grows at the rate of the mean motion."""
    e_cos, e_sin = _eccentric_anomaly(orbit)
    return orbit.argument_of_latitude - _true_less_eccentric(orbit, e_cos, e_sin) - e_sin


def time_of_last_turn(orbit: TargetOrbit, angle: float) -> Scalar:
    """Time [s] in which the target has moved by an `angle` [rad] up to a place on its orbit."""
    before = replace(orbit, argument_of_latitude=orbit.argument_of_latitude - angle)
    mean = mean_argument_of_latitude(orbit) - mean_argument_of_latitude(before)
    return mean / mean_motion(orbit.semi_major_axis)


def unit_rate(orbit: TargetOrbit) -> Scalar:
    """Mean motion of a circular orbit at the semi-latus rectum [rad/s]."""
    return mean_motion(orbit.semi_major_axis * (1.0 - orbit.ex * orbit.ex - orbit.ey * orbit.ey))


def transition_matrix(orbit: TargetOrbit, dt: Scalar) -> Float[Array, "6 6"]:
    """State transition matrix of (rho, rho_dot) in the Hill frame over `dt` [s] from a place on the orbit."""
    identity = jnp.eye(6, dtype=orbit.semi_major_axis.dtype)
    return free_motion(advanced(orbit, dt), dt, constants_of_motion(orbit, identity))


def constants_of_motion(orbit: TargetOrbit, state: Columns) -> Columns:
    """Constants (y0, ax, ay, d, bx, by) [m] of the free motion through a state (rho, rho_dot) [m, m/s], its epoch."""
    kappa, kappa_slope, c, s = _place(orbit)
    x, y, z = state[:3]
    # Derivatives by the argument of latitude.
    x_slope, y_slope, z_slope = state[3:] * (1.0 / _rate(orbit, kappa))
    eta_square = 1.0 - orbit.ex * orbit.ex - orbit.ey * orbit.ey
    log_slope = kappa_slope / kappa
    d = -(y_slope + log_slope * (y - x_slope) + (1.0 + 1.0 / kappa) * x) * (kappa**3 / eta_square)
    radial_cos, radial_sin = -x - d * (2.0 / kappa), x_slope + d * (log_slope / kappa)
    out, out_slope = kappa * z, kappa * z_slope + kappa_slope * z
    return jnp.stack(
        [
            kappa * y - (1.0 + kappa) * radial_sin,
            radial_cos * c + radial_sin * s,
            radial_cos * s - radial_sin * c,
            d,
            out * s + out_slope * c,
            out_slope * s - out * c,
        ]
    )


def free_motion(orbit: TargetOrbit, since: Scalar, constants: Columns) -> Columns:
    """State (rho, rho_dot) [m, m/s] at a place on the orbit, `since` [s] after the epoch of the constants [m]."""
    kappa, kappa_slope, c, s = _place(orbit)
    along, ax, ay, d, bx, by = constants
    tau = since * unit_rate(orbit)
    radial_cos, radial_sin = ax * c + ay * s, ax * s - ay * c
    out, out_slope = bx * s - by * c, bx * c + by * s
    inverse = 1.0 / kappa
    slope = kappa_slope * inverse * inverse
    position = [
        -radial_cos - d * (2.0 * inverse + 3.0 * kappa_slope * tau),
        along * inverse + radial_sin * (1.0 + inverse) + d * (3.0 * kappa * tau),
        out * inverse,
    ]
    by_latitude = [
        radial_sin - d * (slope + 3.0 * (1.0 - kappa) * tau),
        -(along + radial_sin) * slope + radial_cos * (1.0 + inverse) + d * (3.0 * inverse + 3.0 * kappa_slope * tau),
        -out * slope + out_slope * inverse,
    ]
    rate = _rate(orbit, kappa)
    return jnp.stack(position + [component * rate for component in by_latitude])


def rate_without_drift(orbit: TargetOrbit, position: Vector) -> Vector:
    """Velocity along the track (3,) [m/s] with which free motion from a position [m] is back after an orbit."""
    kappa, kappa_slope, _, _ = _place(orbit)
    x, y, _ = position
    y_slope = -(kappa_slope * y + (kappa + 1.0) * x) / kappa
    return jnp.stack([0.0 * x, y_slope * _rate(orbit, kappa), 0.0 * x])


def _place(orbit: TargetOrbit) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Semi-latus rectum over distance, its slope over the argument of latitude; cosine and sine of the latter [-]."""
    c, s = cos_sin(orbit.argument_of_latitude)
    return 1.0 + orbit.ex * c + orbit.ey * s, orbit.ey * c - orbit.ex * s, c, s


def _eccentric_anomaly(orbit: TargetOrbit) -> tuple[Scalar, Scalar]:
    """Eccentricity times cosine and sine of the eccentric anomaly [-]."""
    kappa, kappa_slope, _, _ = _place(orbit)
    e_square = orbit.ex * orbit.ex + orbit.ey * orbit.ey
    return (e_square + kappa - 1.0) / kappa, -jnp.sqrt(1.0 - e_square) * kappa_slope / kappa


def _true_less_eccentric(orbit: TargetOrbit, e_cos: Scalar, e_sin: Scalar) -> Scalar:
    """True less eccentric anomaly [rad], from the eccentricity times cosine and sine of the latter."""
    return 2.0 * arctan2(e_sin, 1.0 + _eta(orbit) - e_cos)


def _eta(orbit: TargetOrbit) -> Scalar:
    """Semi-minor over semi-major axis [-]."""
    return jnp.sqrt(1.0 - orbit.ex * orbit.ex - orbit.ey * orbit.ey)


def _rate(orbit: TargetOrbit, kappa: Scalar) -> Scalar:
    """Rate of the argument of latitude [rad/s]."""
    return unit_rate(orbit) * kappa * kappa


@jax.custom_jvp
def _eccentric_change(e_cos: Scalar, e_sin: Scalar, mean_change: Scalar) -> Scalar:
    """Change of the eccentric anomaly E [rad] with a change of the mean anomaly [rad], from e cos E and e sin E.

    Newton's method from above the solution, where Kepler's function is convex: it cannot overshoot.
    """
    e = gradient_safe.sqrt(e_cos * e_cos + e_sin * e_sin)
    before = arctan2(e_sin, e_cos)
    mean = before - e_sin + mean_change
    turns = 2.0 * jnp.pi * jnp.round(mean / (2.0 * jnp.pi))
    within = jnp.abs(mean - turns)
    bound = jnp.minimum(jnp.minimum(within + e, within / (1.0 - e)), jnp.pi)

    def newton(change: Scalar, _: None) -> tuple[Scalar, None]:
        # With half the angle, a small change keeps its digits.
        c, s = cos_sin(0.5 * change)
        residual = change - 2.0 * s * (e_cos * c - e_sin * s) - mean_change
        return change - residual / (1.0 - e_cos * (1.0 - 2.0 * s * s) + 2.0 * e_sin * s * c), None

    start = turns + jnp.where(mean < turns, -bound, bound) - before
    return jax.lax.scan(newton, start, None, length=_NEWTON_STEPS)[0]


@_eccentric_change.defjvp
def _eccentric_change_jvp(primals: tuple[ArrayLike, ...], tangents: tuple[ArrayLike, ...]) -> tuple[Array, Array]:
    """Derivative of Kepler's equation itself."""
    e_cos, e_sin, mean_change = map(jnp.asarray, primals)
    d_cos, d_sin, d_mean = map(jnp.asarray, tangents)
    change = _eccentric_change(e_cos, e_sin, mean_change)
    c, s = cos_sin(0.5 * change)
    sine, versine = 2.0 * s * c, 2.0 * s * s
    slope = 1.0 - e_cos * (1.0 - versine) + e_sin * sine
    return change, (d_mean + sine * d_cos - versine * d_sin) / slope


_NEWTON_STEPS: Final = 6
"""Steps after which Newton's method has converged at an eccentricity of 0.9."""


_LEAST_NODE_SINE: Final = 1e-3
"""Sine of the inclination below which the node is not used: 100 m across a geostationary orbit move it by 0.1 deg."""
