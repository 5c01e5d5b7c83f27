"""Frame of a target that turns, in which a phase may have its reference: places before a port, and ways to it.

Its axes are those of T, and its origin is that of the target's mesh, from which the filter knows the centre of mass.
"""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics.small_systems import inverse_positive_definite
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, apply_transposed, cross, product
from rpojax.flight.navigation import target_attitude_ekf
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
State = Float[Array, "6"]
Scalar = Float[Array, ""]

AUTHORITY_RATIO: Final = 2.0
"""Thrust that is needed over the centripetal one, at least [-]: the rest is for errors, and for slowing down."""


@pytree
class TargetFrame:
    """Where the target's frame is, and how it moves.

    Attributes:
        R_TH: (3, 3) from the Hill frame
        omega_TN_T: (3,) rate of the target [rad/s]
        acceleration_T: (3,) of its rate, free of torque [rad/s^2]
        origin_T: (3,) from the centre of mass [m]
        orbit_rate: () rate of the Hill frame about its z axis [rad/s]
    """

    R_TH: Array
    omega_TN_T: Array
    acceleration_T: Array
    origin_T: Array
    orbit_rate: Array

    @property
    def omega_TH_T(self) -> Vector:
        """Rate against the Hill frame [rad/s]."""
        return self.omega_TN_T - self.orbit_rate * self.R_TH[:, 2]


def by_estimate(relative: RelativeEstimate, R_HN: Matrix, omega_HN_N: Vector) -> TargetFrame | None:
    """Frame by the filter's estimate, and by the present Hill frame; None of a filter without the attitude."""
    reference, slow = relative.target, relative.slow
    if reference is None:
        return None
    q_TN = target_attitude_ekf.attitude(reference, slow)
    inertia = target_attitude_ekf.inertia_of(reference.inertia, slow["inertia_ratio"])
    return of_target(q_TN, slow["rate"], inertia, slow["body_offset"], R_HN, omega_HN_N)


def of_target(
    q_TN: Float[Array, "4"],
    omega_TN_T: Vector,
    inertia: Matrix,
    origin_T: Vector,
    R_HN: Matrix,
    omega_HN_N: Vector,
) -> TargetFrame:
    """Frame of a target with that attitude, rate [rad/s] and inertia, of which only the ratios count."""
    gyroscopic = -cross(omega_TN_T, apply(inertia, omega_TN_T))
    return TargetFrame(
        R_TH=product(quaternion.to_matrix(q_TN), R_HN.T),
        omega_TN_T=omega_TN_T,
        acceleration_T=apply(inverse_positive_definite(inertia), gyroscopic),
        origin_T=origin_T,
        orbit_rate=jnp.sum(R_HN[2] * omega_HN_N, axis=0),
    )


def ahead(frame: TargetFrame, orbit: TargetOrbit, later: TargetOrbit, dt: float) -> TargetFrame:
    """The frame a tick of `dt` [s] later, while the target goes from `orbit` to `later`."""
    mean_rate = frame.omega_TN_T + 0.5 * dt * frame.acceleration_T
    turned = quaternion.to_matrix(quaternion.exp(-dt * mean_rate))
    angle = later.argument_of_latitude - orbit.argument_of_latitude
    c, s = jnp.cos(angle), jnp.sin(angle)
    # Columns of the later Hill axes in the earlier ones.
    x, y, z = frame.R_TH[:, 0], frame.R_TH[:, 1], frame.R_TH[:, 2]
    later_axes = jnp.stack([c * x + s * y, c * y - s * x, z], axis=1)
    return replace(
        frame,
        R_TH=product(turned, later_axes),
        omega_TN_T=frame.omega_TN_T + dt * frame.acceleration_T,
    )


def can_be_followed(frame: TargetFrame, authority: Scalar, mass: Scalar, distance: Scalar) -> Bool[Array, ""]:
    """Whether thrusters of a force [N] in any direction keep a mass [kg] at a distance [m] in the turning frame."""
    square = jnp.sum(frame.omega_TN_T * frame.omega_TN_T, axis=0)
    return AUTHORITY_RATIO * square * distance * mass <= authority


def to_hill(frame: TargetFrame, state: State) -> State:
    """Relative state in H [m, m/s] of one in the target's frame."""
    place_T = state[:3] + frame.origin_T
    velocity_T = state[3:] + cross(frame.omega_TH_T, place_T)
    return jnp.concatenate([apply_transposed(frame.R_TH, place_T), apply_transposed(frame.R_TH, velocity_T)])


def from_hill(frame: TargetFrame, state_H: State) -> State:
    """Inverse of `to_hill`."""
    place_T = apply(frame.R_TH, state_H[:3])
    velocity_T = apply(frame.R_TH, state_H[3:]) - cross(frame.omega_TH_T, place_T)
    return jnp.concatenate([place_T - frame.origin_T, velocity_T])
