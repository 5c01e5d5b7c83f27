"""Relative motion by the estimate, now and at the middle of a burn that is decided now, with its covariance."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import line_of_sight_uncertainty, target_frame
from rpojax.flight.guidance.target_frame import TargetFrame
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


@pytree
class Prediction:
    """Estimated relative motion now and at the middle of a burn that is decided now.

    Attributes:
        orbit: of the target now
        state_H: (6,) now [m, m/s]
        burn_orbit: of the target at the burn
        burn_state_H: (6,) at the burn, without another one before [m, m/s]
        R_CN: (3, 3) Hill frame at the burn
        range_ratio_sigma: () 1-sigma of the range over the range [-]
        covariance_H: (6, 6) of the state now
        burn_covariance_H: (6, 6) of that at the burn
        target_frame: of the target that turns, now; None where the filter does not know its attitude
    """

    orbit: TargetOrbit
    state_H: Array
    burn_orbit: TargetOrbit
    burn_state_H: Array
    R_CN: Array
    range_ratio_sigma: Array
    covariance_H: Array
    burn_covariance_H: Array
    target_frame: TargetFrame | None = None


def predict_to_burn(params: FlightParams, estimate: OrbitEstimate, after: Scalar | None = None) -> Prediction:
    """Relative motion up to a burn that is decided now, or `after` [s]."""
    lead = params.formation.lead if after is None else params.formation.lead + after
    relative, servicer = estimate.relative, estimate.servicer
    r_TN_N, v_TN_N = servicer.r_SN_N + relative.r_TS_N, servicer.v_SN_N + relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)
    state_H = jnp.concatenate(inertial_to_hill(-relative.r_TS_N, -relative.v_TS_N, R_HN, omega_HN_N))
    orbit = yamanaka_ankersen.target_orbit(r_TN_N, v_TN_N)
    burn_orbit = yamanaka_ankersen.advanced(orbit, lead)
    columns = jnp.concatenate([jnp.eye(6, dtype=state_H.dtype), state_H[:, None]], axis=1)
    constants = yamanaka_ankersen.constants_of_motion(orbit, columns)
    moved = yamanaka_ankersen.free_motion(burn_orbit, lead, constants)
    covariance_H = _in_hill_frame(relative.motion_covariance, R_HN, omega_HN_N)
    angle = burn_orbit.argument_of_latitude - orbit.argument_of_latitude
    c, s = jnp.cos(angle), jnp.sin(angle)
    return Prediction(
        orbit=orbit,
        state_H=state_H,
        burn_orbit=burn_orbit,
        burn_state_H=moved[:, 6],
        R_CN=jnp.stack([c * R_HN[0] + s * R_HN[1], -s * R_HN[0] + c * R_HN[1], R_HN[2]]),
        range_ratio_sigma=line_of_sight_uncertainty.relative_range_sigma(estimate),
        covariance_H=covariance_H,
        burn_covariance_H=_mapped(moved[:, :6], covariance_H),
        target_frame=target_frame.by_estimate(relative, R_HN, omega_HN_N),
    )


def _in_hill_frame(covariance_N: Float[Array, "6 6"], R_HN: Matrix, omega_HN_N: Vector) -> Float[Array, "6 6"]:
    """Covariance of the relative position and velocity in H, from that in N."""
    x, y, z = omega_HN_N
    # Of the cross product of a position with the rate, which the velocity in a turning frame lacks.
    by_position = jnp.stack([R_HN[:, 2] * y - R_HN[:, 1] * z, R_HN[:, 0] * z - R_HN[:, 2] * x,
                             R_HN[:, 1] * x - R_HN[:, 0] * y], axis=1)  # fmt: skip
    upper = jnp.concatenate([R_HN, jnp.zeros_like(R_HN)], axis=1)
    return _mapped(jnp.concatenate([upper, jnp.concatenate([by_position, R_HN], axis=1)]), covariance_N)


def _mapped(matrix: Float[Array, "6 6"], covariance: Float[Array, "6 6"]) -> Float[Array, "6 6"]:
    """Covariance of a linear function of a state."""
    half = jnp.sum(matrix[:, :, None] * covariance[None], axis=1)
    return jnp.sum(half[:, None] * matrix[None], axis=2)
