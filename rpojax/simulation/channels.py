"""Channels of a tick: named quantities for recording, with their unit in the name."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion, vectors
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.mahalanobis_distance import squared_mahalanobis_and_log_determinant
from rpojax.core.numerics import gradient_safe, trigonometric_series
from rpojax.core.orbits import clohessy_wiltshire, keplerian_elements
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import apply
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import camera_models
from rpojax.simulation.camera_models import boresight_N
from rpojax.simulation.estimation_errors import orbit_errors
from rpojax.simulation.telemetry import Telemetry

Channels = dict[str, Array]
"""Channels by name."""
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def compute_channels(scenario: Scenario, params: Params, telemetry: Telemetry) -> Channels:
    """Channels of one tick: vectors in the true Hill frame, errors as estimate minus truth, sigmas as 1 sigma."""
    with jax.named_scope("observe"):
        channels = {
            **_relative_position(telemetry),
            **_navigation_errors(telemetry),
            **_innovations(telemetry),
            **_camera(scenario, params, telemetry),
            **_expected_box(scenario, params, telemetry),
            **_vehicle(params, telemetry),
            "passive_range_m": _passive_range(telemetry),
        }
        if scenario.camera_model == "rendered":
            channels |= _picture_geometry(telemetry)
        return {name: _to_single_precision(value) for name, value in channels.items()}


def _to_single_precision(value: Array) -> Array:
    """Floating-point values in single precision, which halves the records of a campaign."""
    return value.astype(jnp.float32) if jnp.issubdtype(value.dtype, jnp.floating) else value


def _relative_position(telemetry: Telemetry) -> Channels:
    truth, orbit = telemetry.truth, telemetry.flight.orbit
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    return {
        "rho_H": apply(R_HN, truth.r_ST_N),
        "rho_estimate_H": apply(R_HN, -orbit.relative.r_TS_N),
        "range_m": gradient_safe.norm(truth.r_ST_N),
    }


def _navigation_errors(telemetry: Telemetry) -> Channels:
    truth, orbit = telemetry.truth, telemetry.flight.orbit
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    servicer, relative = orbit_errors(telemetry)
    servicer_error, relative_error = servicer[:3], relative[:3]
    P_servicer, P_relative = orbit.servicer.covariance[:6, :6], orbit.relative.covariance[:6, :6]
    nees_relative, _ = squared_mahalanobis_and_log_determinant(P_relative, relative)
    nees_servicer, _ = squared_mahalanobis_and_log_determinant(P_servicer, servicer)
    return {
        "relative_error_H": apply(R_HN, relative_error),
        "relative_sigma_H": _hill_sigma(R_HN, P_relative[:3, :3]),
        "servicer_error_H": apply(R_HN, servicer_error),
        "servicer_sigma_H": _hill_sigma(R_HN, P_servicer[:3, :3]),
        "target_error_H": apply(R_HN, servicer_error + relative_error),
        "target_sigma_H": _hill_sigma(R_HN, P_servicer[:3, :3] + P_relative[:3, :3]),
        "nees": nees_servicer + nees_relative,
        "nees_relative": nees_relative,
    }


def _innovations(telemetry: Telemetry) -> Channels:
    """Decorrelated innovations divided by their sigma; NaN for rows that were not used."""
    innovation = telemetry.innovation
    used = innovation.weight > 0.5
    sigmas = jnp.where(used, innovation.innovation / gradient_safe.sqrt(innovation.variance), jnp.nan)
    return {"gps_innovation_sigmas": sigmas[:3], "box_innovation_sigmas": sigmas[3:]}


def _camera(scenario: Scenario, params: Params, telemetry: Telemetry) -> Channels:
    truth, frame = telemetry.truth, telemetry.frame
    vehicle = params.flight.vehicle
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    edges = frame.box.edges
    measured = camera_models.box_measurement(scenario, params, frame)
    ray_K = jnp.concatenate([measured.tangent, jnp.ones(1, dtype=jnp.float64)])
    q_KB = quaternion.normalize(vehicle.camera_mounting)
    q_KN = quaternion.multiply(q_KB, telemetry.flight.attitude.q_BN)
    ray_N = rotate(quaternion.conjugate(q_KN), gradient_safe.normalize(ray_K))
    size = params.flight.navigation.target_size
    return {
        "box_present": frame.box.present,
        "box_accepted": telemetry.innovation.accepted,
        "box_outlier": frame.box.present & frame.outlier,
        "box_truncated": frame.box.present & frame.box.truncated,
        "observable": frame.observable,
        "box_bearing_H": apply(R_HN, ray_N),
        "box_range_m": size * jnp.exp(-measured.log_size),
        "box_px": _corner_and_sides(edges),
        "box_score": frame.score,
        "outline_px": _corner_and_sides(frame.outline),
    }


def _corner_and_sides(edges: Float[Array, "4"]) -> Float[Array, "4"]:
    return jnp.concatenate([edges[:2], edges[2:] - edges[:2]])


def _expected_box(scenario: Scenario, params: Params, telemetry: Telemetry) -> Channels:
    """Box predicted by the orbit filter and its gate, NaN if the target is predicted behind the camera."""
    expected = telemetry.innovation.expected_box
    focal, sigmas = params.flight.vehicle.focal_px, params.flight.navigation.gate_sigma
    center_px = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=jnp.float64)
    center = center_px + focal * expected.values[:2]
    side = focal * jnp.exp(expected.values[2:])
    return {
        "expected_px": jnp.where(expected.in_front, jnp.concatenate([center, side]), jnp.nan),
        "gate_px": jnp.where(expected.in_front, sigmas * focal * gradient_safe.sqrt(expected.variance[:2]), jnp.nan),
    }


def _picture_geometry(telemetry: Telemetry) -> Channels:
    """Window and poses of the image of a tick, from which it can be rendered again."""
    truth = telemetry.truth
    return {
        "window_px": telemetry.frame.window,
        "r_TN_N": truth.r_TN_N,
        "r_ST_N": truth.r_ST_N,
        "q_TN": truth.q_TN,
        "q_BN": truth.q_BN,
    }


def _vehicle(params: Params, telemetry: Telemetry) -> Channels:
    truth = telemetry.truth
    ahead_N = boresight_N(params, truth)
    line_N = -gradient_safe.normalize(truth.r_ST_N)
    off = trigonometric_series.arctan2(
        gradient_safe.norm(vectors.cross(ahead_N, line_N)), jnp.sum(ahead_N * line_N, axis=0)
    )
    return {
        "mode": telemetry.mode.astype(jnp.int8),
        "running": telemetry.running,
        "pointing_error_deg": jnp.rad2deg(off),
        "wheel_speed_fraction": truth.wheel_speed / params.plant.wheels.speed_limit,
        "delta_v_m_s": truth.delta_v,
        "mass_kg": truth.mass,
    }


def _passive_range(telemetry: Telemetry) -> Scalar:
    """Least range over one orbit of free drift from this tick [m]; evaluated once in ten ticks, else infinite."""
    truth = telemetry.truth
    # Outside of the branch, because other channels use it too.
    frame = hill_frame(truth.r_TN_N, truth.v_TN_N)

    def evaluate(_: None) -> Scalar:
        n = keplerian_elements.mean_motion(keplerian_elements.semi_major_axis(truth.r_TN_N, truth.v_TN_N))
        return clohessy_wiltshire.minimum_drift_distance(n, *inertial_to_hill(truth.r_ST_N, truth.v_ST_N, *frame))

    due = telemetry.tick % _PASSIVE_RANGE_PERIOD == 0
    return jax.lax.cond(due, evaluate, lambda _: jnp.full((), jnp.inf, dtype=jnp.float64), None)


_PASSIVE_RANGE_PERIOD = 10
"""Ticks between two evaluations of the free drift, about the duration of a burn."""


def _hill_sigma(R_HN: Matrix, P_N: Matrix) -> Vector:
    """1-sigma along the Hill axes."""
    PR = jnp.sum(P_N[None, :, :] * R_HN[:, None, :], axis=2)
    return gradient_safe.sqrt(jnp.sum(R_HN * PR, axis=1))
