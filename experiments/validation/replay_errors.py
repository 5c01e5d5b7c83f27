"""Differences between a replayed trajectory and its reference."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from experiments.validation.plant_from_reference import sunlight
from experiments.validation.reference_file import Numbers, Reference
from rpojax.core import quaternion
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.orbits import eclipse
from rpojax.physics.plant_state import Truth


def largest_errors(reference: Reference, truth: Truth) -> dict[str, float | None]:
    """Largest differences by name; None for histories that the reference lacks."""
    r_SN_N, v_SN_N = truth.r_TN_N + truth.r_ST_N, truth.v_TN_N + truth.v_ST_N
    position = {"r": r_SN_N, "r_target": truth.r_TN_N, "r_chaser": r_SN_N}
    velocity = {"v": v_SN_N, "v_target": truth.v_TN_N, "v_chaser": v_SN_N}
    return {
        "position_error_m": _largest_distance(reference, position),
        "velocity_error_m_s": _largest_distance(reference, velocity),
        "attitude_error_rad": _maximum_or_none(attitude_errors(reference, truth)),
        "rate_error_rad_s": _largest_distance(reference, {"omega": truth.omega_BN_B}),
        "relative_position_error_m": _maximum_or_none(relative_errors(reference, truth)),
        "illumination_error": _maximum_or_none(illumination_errors(reference)),
        "wheel_speed_error_rad_s": _largest_distance(reference, {"Omega": truth.wheel_speed}),
    }


def _largest_distance(reference: Reference, propagated: dict[str, Array]) -> float | None:
    """Largest distance between propagated histories and those of the reference."""
    found = [float(np.max(_distances(ours, reference[key]))) for key, ours in propagated.items() if key in reference]
    return max(found) if found else None


def _distances(ours: Array | Numbers, theirs: Numbers) -> Numbers:
    return np.linalg.norm(np.asarray(ours) - theirs, axis=1)


def _maximum_or_none(values: Numbers | None) -> float | None:
    return None if values is None else float(np.max(values))


def attitude_errors(reference: Reference, truth: Truth) -> Numbers | None:
    """Angles between attitudes at the samples [rad]; the quaternion of the file is the conjugate of `q_BN`."""
    if "q" not in reference:
        return None
    between = np.asarray(jax.jit(jax.vmap(quaternion.multiply))(truth.q_BN, reference["q"]))
    return 2.0 * np.arctan2(np.linalg.norm(between[:, 1:], axis=1), np.abs(between[:, 0]))


def relative_errors(reference: Reference, truth: Truth) -> Numbers | None:
    """Differences [m] of the chaser's position from the target, in the target's Hill frame, at the samples."""
    if "r_target" not in reference:
        return None
    if "rho" in reference:
        return _distances(_positions_in_hill_frame(truth), reference["rho"])
    return _distances(truth.r_ST_N, reference["r_chaser"] - reference["r_target"])


@jax.jit
@jax.vmap
def _positions_in_hill_frame(truth: Truth) -> Array:
    return inertial_to_hill(truth.r_ST_N, truth.v_ST_N, *hill_frame(truth.r_TN_N, truth.v_TN_N))[0]


def illumination_errors(reference: Reference) -> Numbers | None:
    """Differences of the lit fraction of the Sun at the positions of the file, at the samples.

    At the propagated positions an error of a millimetre would change the fraction by 1e-8 in the penumbra. Not
    compiled: fused operations round differently, which costs half of the digits in the penumbra.
    """
    if "illumination" not in reference:
        return None
    sun, light = jnp.asarray(reference["r_sun"]), sunlight(reference)
    with jax.disable_jit():
        fraction = jax.vmap(lambda r: eclipse.illumination(r, sun, light.shadow_radius, light.sun_radius))
        ours = np.asarray(fraction(jnp.asarray(reference["r"])))
    return np.abs(ours - reference["illumination"])
