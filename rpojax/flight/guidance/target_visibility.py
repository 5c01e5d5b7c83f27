"""Visibility of the estimated target: light of Sun and lamp, limits of the camera, and reach of a LiDAR."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import lamp, quaternion
from rpojax.core.numerics.gradient_safe import norm, normalize
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.orbits import camera_visibility
from rpojax.core.vectors import cross
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Flag = Bool[Array, ""]
Scalar = Float[Array, ""]


def is_visible(
    vehicle: VehicleModel,
    estimate: OrbitEstimate,
    sun_N: Vector,
    tolerance: Scalar | float = 0.0,
    q_BN: Float[Array, "4"] | None = None,
) -> Flag:
    """True while the target should be visible by the estimate, the Sun at `sun_N` [m] and the camera's limits.

    `tolerance` [rad] widens the limits. The beam of a lamp is where it is at an attitude `q_BN`; without one the camera
    is taken to point at the target, and the lamp beside it.
    """
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    # Cosines are monotonous between zero and a half circle only.
    phase = jnp.minimum(vehicle.phase_limit + tolerance, math.pi)
    exclusion = jnp.maximum(vehicle.sun_exclusion - tolerance, 0.0)
    conditions = (r_TN_N, -estimate.relative.r_TS_N, sun_N, phase, exclusion)
    return _by_sun_or_lamp(conditions, _is_lamplit(vehicle, estimate.relative.r_TS_N, tolerance, q_BN))


def _is_lamplit(
    vehicle: VehicleModel, r_TS_N: Vector, tolerance: Scalar | float = 0.0, q_BN: Float[Array, "4"] | None = None
) -> Flag | None:
    """Whether the lamp lights the target, None without one."""
    if vehicle.lamp is None:
        return None
    if q_BN is None:
        return lamp.is_in_reach(vehicle.lamp, norm(r_TS_N), tolerance)
    return lamp.lights(vehicle.lamp, quaternion.rotate(q_BN, r_TS_N), tolerance)


def _by_sun_or_lamp(conditions: tuple[Vector, Vector, Vector, Scalar, Scalar], lamplit: Flag | None) -> Flag:
    """Whether the target can be seen, with the arguments of `viewing_conditions`."""
    if lamplit is None:
        return camera_visibility.is_observable(*conditions)
    by_sun, by_lamp = camera_visibility.light_sources(*conditions, lamplit)
    return by_sun | by_lamp


def is_in_sight(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector, tolerance: Scalar | float = 0.0) -> Flag:
    """True while the target should be visible, or so near that a LiDAR shows it without light."""
    visible = is_visible(vehicle, estimate, sun_N, tolerance)
    return visible if vehicle.dark_reach is None else visible | _is_within(vehicle.dark_reach, estimate)


def _is_within(reach: Scalar, estimate: OrbitEstimate) -> Flag:
    r_TS_N = estimate.relative.r_TS_N
    return jnp.sum(r_TS_N * r_TS_N, axis=0) < reach**2


def is_in_sight_after(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector, angle: Scalar) -> Flag:
    """Whether the target should be in sight when the orbit has turned by `angle` [rad], with the same motion in H."""
    servicer, relative = estimate.servicer, estimate.relative
    normal = normalize(cross(servicer.r_SN_N, servicer.v_SN_N))
    c, s = cos_sin(angle)

    def turned(vector: Vector) -> Vector:
        return c * vector + s * cross(normal, vector) + (1.0 - c) * jnp.sum(normal * vector, axis=0) * normal

    r_TN_N, r_ST_N = turned(servicer.r_SN_N + relative.r_TS_N), turned(-relative.r_TS_N)
    conditions = (r_TN_N, r_ST_N, sun_N, vehicle.phase_limit, vehicle.sun_exclusion)
    visible = _by_sun_or_lamp(conditions, _is_lamplit(vehicle, relative.r_TS_N))
    return visible if vehicle.dark_reach is None else visible | _is_within(vehicle.dark_reach, estimate)


VISIBILITY_TOLERANCE = math.radians(10.0)
"""Widening of the camera's light limits within which a box is accepted [rad]: the largest plausible bearing error,
three sigma of a hand-over by 1.5 m at 30 m being 8.6 deg."""
