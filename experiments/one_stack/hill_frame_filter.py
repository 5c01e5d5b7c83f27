"""A filter of another layout in place of the packaged one: seven states in the target's Hill frame.

    python experiments/one_stack/hill_frame_filter.py --runs 8 --out DIR

The states are relative position and velocity of the servicer and the log of the target's size over the believed one,
with the equations of Clohessy and Wiltshire. White noise of bearing and size is large enough to stand for the slow
errors that the filter has no states for. The servicer's own orbit stays with the packaged filter.
"""

import argparse
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import rpojax
from rpojax.core import quaternion
from rpojax.core.frames import hill_frame, hill_to_inertial, inertial_to_hill
from rpojax.core.orbits.clohessy_wiltshire import transition_matrix

Own = dict[str, Array]
"""Mean (7,) [m, m/s, -] and covariance (7, 7)."""


def target_frame(estimate: Any) -> tuple[Array, Array]:
    """Hill frame of the target, and its rate [rad/s] in N."""
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    return hill_frame(r_TN_N, estimate.servicer.v_SN_N + estimate.relative.v_TS_N)


def start(estimate: Any, params: Any) -> Own:
    """Memory at the hand-over, from the estimate and its sigmas."""
    tuning, frame = params.navigation, target_frame(estimate)
    motion = inertial_to_hill(-estimate.relative.r_TS_N, -estimate.relative.v_TS_N, *frame)
    position = jnp.full(3, tuning.initial_relative_position_sigma)
    velocity = jnp.full(3, tuning.initial_relative_velocity_sigma)
    sigma = jnp.concatenate([position, velocity, tuning.target_size_sigma[None]])
    return {"mean": jnp.concatenate([*motion, jnp.zeros(1)]), "covariance": jnp.diag(sigma**2)}


def as_estimate(estimate: Any, own: Own) -> Any:
    """Estimate for the rest of the flight software."""
    frame = target_frame(estimate)

    def to_inertial(state: Array) -> Array:
        return -jnp.concatenate(hill_to_inertial(state[:3], state[3:], *frame))

    motion, turn = to_inertial(own["mean"][:6]), jax.jacfwd(to_inertial)(own["mean"][:6])
    others = estimate.relative.covariance.at[:6].set(0.0).at[:, :6].set(0.0)
    covariance = others.at[:6, :6].set(turn @ own["covariance"][:6, :6] @ turn.T)
    relative = replace(estimate.relative, r_TS_N=motion[:3], v_TS_N=motion[3:], covariance=covariance)
    return replace(estimate, relative=relative)


def predict(estimate: Any, delta_v_N: Array, dt: float, own: Own, **others: Any) -> tuple[Any, Own]:
    """Packaged propagation of the servicer's orbit; relative motion by Clohessy and Wiltshire."""
    R_HN, omega_N = target_frame(estimate)
    A = jnp.eye(7).at[:6, :6].set(transition_matrix(jnp.linalg.norm(omega_N), jnp.asarray(dt)))
    burn_H = R_HN @ delta_v_N
    noise = (0.05 * jnp.linalg.norm(burn_H)) ** 2 + 1e-5**2 * dt
    after = rpojax.Stages().call("orbit_predict", estimate=estimate, delta_v_N=delta_v_N, dt=dt, **others)
    own = {
        "mean": A @ own["mean"].at[3:6].add(burn_H),
        "covariance": A @ own["covariance"] @ A.T + jnp.diag(jnp.zeros(7).at[3:6].set(noise)),
    }
    return as_estimate(after, own), own


def update(
    estimate: Any, box: Any, q_KN: Array, tuning: Any, focal_px: Array, own: Own, **others: Any
) -> tuple[Any, Own]:
    """Packaged update of the servicer's orbit by GPS; bearing and size of the box update the seven states."""
    no_box = replace(box, present=jnp.zeros((), bool))
    arguments = {"estimate": estimate, "box": no_box, "q_KN": q_KN, "tuning": tuning, "focal_px": focal_px, **others}
    after, gate, innovation = rpojax.Stages().call("orbit_update", **arguments)
    R_HN, _ = target_frame(estimate)

    def expected(state: Array) -> Array:
        x, y, z = quaternion.rotate(q_KN, -(R_HN.T @ state[:3]))
        z = jnp.maximum(z, 1.0)  # while the camera looks away there is no box
        return jnp.stack([x / z, y / z, jnp.log(tuning.target_size / z) + state[6]])

    prior, P = own["mean"], own["covariance"]
    measured = jnp.append(box.tangent, box.log_size)
    bearing = 10.0 * jnp.hypot(tuning.edge_noise / focal_px, tuning.center_sigma / jnp.linalg.norm(prior[:3]))
    noise = jnp.stack([bearing, bearing, 10.0 * tuning.scale_sigma[0]]) ** 2
    value, H = expected(prior), jax.jacfwd(expected)(prior)
    mean, residuals, variances, uses = prior, [], [], []
    for row in range(3):
        residual = measured[row] - value[row] - H[row] @ (mean - prior)
        variance = H[row] @ P @ H[row] + noise[row]
        used = box.present & (residual**2 < 25.0 * variance) & ((row < 2) | ~box.truncated)
        gain = jnp.where(used, P @ H[row] / variance, 0.0)
        mean, P = mean + gain * residual, P - jnp.outer(gain, H[row] @ P)
        residuals.append(residual)
        variances.append(variance)
        uses.append(used)
    accepted = uses[0] & uses[1]
    of_box = replace(
        innovation.sensors["box"],
        innovation=jnp.stack(residuals),
        variance=jnp.stack(variances),
        used=jnp.stack(uses),
        accepted=accepted,
        rejected=box.present & ~accepted,
    )
    innovation = replace(innovation, sensors={**innovation.sensors, "box": of_box})
    own = {"mean": mean, "covariance": 0.5 * (P + P.T)}
    return (as_estimate(after, own), gate, innovation), own


STAGES = rpojax.Stages(own_memory=start, orbit_predict=predict, orbit_update=update)


def main() -> None:
    """Flies `inspection` with the filter, and prints what it reached."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--out", default="out/hill_frame_filter")
    options = parser.parse_args()
    campaign = rpojax.run_campaign(rpojax.load("inspection"), options.runs, options.out, stages=STAGES)
    for name in ("nav_relative_position_error_rms_m", "formation_error_rms_m", "sigma3_coverage"):
        values = campaign.metrics[name]
        print(f"{name}: median {np.median(values):.3f}, {values.min():.3f} to {values.max():.3f}")


if __name__ == "__main__":
    main()
