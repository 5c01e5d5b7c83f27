"""Formation control law: gain of the discrete linear-quadratic regulator, and the velocity change by it."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.flight.control import riccati
from rpojax.flight.control.formation_tuning import FormationTuning

Scalar = Float[Array, ""]


def lqr_gain(formation: FormationTuning, n: Scalar, period: float) -> Float[Array, "3 6"]:
    """Gain of the discrete LQR with one impulse every `period` [s] at mean motion `n` [rad/s].

    The weights are discrete: they count once per burn, not per second. The state is the deviation just before the
    impulse; `x' = Phi(period) (x + [0; dv])`.
    """
    A = transition_matrix(n, jnp.asarray(period, dtype=n.dtype))
    B = A[:, 3:]
    Q = jnp.diag(jnp.concatenate([formation.position_weight, formation.velocity_weight]))
    R = jnp.diag(formation.delta_v_weight)
    P = riccati.solve_riccati(A, B, Q, R)
    return riccati.optimal_gain(A, B, R, P)


def lqr_feedback(gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Float[Array, "3"]:
    """Velocity change in H [m/s] by linear state feedback on the deviation of (rho, rho_dot) [m, m/s]."""
    return -jnp.sum(gain * deviation[None, :], axis=1)
