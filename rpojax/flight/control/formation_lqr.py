"""Formation keeping: an LQR on linearised relative motion, sampled once per burn."""

from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rpojax.core.orbits.orbital_mechanics import transition_matrix
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
_DOUBLINGS = 24


@pytree
class FormationTuning:
    """Where to be, and at what price.

    Attributes:
        desired_position: (3,) servicer from target in H [m]
        position_weight: (3,) weight of the squared position deviation per burn [1/m^2]
        velocity_weight: (3,) weight of the squared velocity deviation per burn [s^2/m^2]
        delta_v_weight: (3,) weight of the squared velocity change per burn [s^2/m^2]
        lead: () from the decision to the middle of the burn [s]
        dead_band: () smaller velocity changes are not made [m/s]
        range_uncertainty_limit: () no burn above this ratio of 1-sigma range error to range [-]
        thruster_retry: () after a burn that gave no thrust, the next try waits so long [s]
    """

    desired_position: Array
    position_weight: Array
    velocity_weight: Array
    delta_v_weight: Array
    lead: Array
    dead_band: Array
    range_uncertainty_limit: Array
    thruster_retry: Array


@runtime_checkable
class FormationLaw(Protocol):
    """A formation controller that can take the place of `lqr`."""

    def __call__(self, gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Vector:
        """Velocity change in H [m/s] for the predicted deviation of (rho, rho_dot) at the burn [m, m/s]."""
        ...


def lqr_feedback(gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Vector:
    """Velocity change in H [m/s] by state feedback."""
    return -jnp.sum(gain * deviation[None, :], axis=1)


@pytree
class StationKeeping:
    """How the station is kept: the free motion that comes back to it after a period, and the impulse between two such.

    A place off the along-track axis does not stay where it is. Both vectors are zero for one that does.

    Attributes:
        arrival_velocity: (3,) rho_dot with which the free motion comes back [m/s]
        impulse: (3,) velocity change there that makes it begin anew [m/s]
    """

    arrival_velocity: Array
    impulse: Array


def solve_station_keeping(formation: FormationTuning, n: Scalar, period: float) -> StationKeeping:
    """The motion that leaves the desired position and is back after a `period` [s] at mean motion `n` [rad/s]."""
    transition = transition_matrix(n, jnp.asarray(period, dtype=jnp.float64))
    position = formation.desired_position
    drift = position - jnp.sum(transition[:3, :3] * position[None, :], axis=1)
    departure = jnp.linalg.solve(transition[:3, 3:], drift)
    arrival = jnp.sum(transition[3:] * jnp.concatenate([position, departure])[None, :], axis=1)
    return StationKeeping(arrival_velocity=arrival, impulse=departure - arrival)


def lqr_gain(formation: FormationTuning, n: Scalar, period: float) -> Float[Array, "3 6"]:
    """Gain of the discrete LQR with one impulse every `period` [s] at mean motion `n` [rad/s].

    The weights are discrete: they count once per burn, not per second. The state is the deviation just before the
    impulse; `x' = Phi(period) (x + [0; dv])`.
    """
    A = transition_matrix(n, jnp.asarray(period, dtype=jnp.float64))
    B = A[:, 3:]
    Q = jnp.diag(jnp.concatenate([formation.position_weight, formation.velocity_weight]))
    R = jnp.diag(formation.delta_v_weight)
    P = solve_riccati(A, B, Q, R)
    return _optimal_gain(A, B, R, P)


def _optimal_gain(A: Array, B: Array, R: Array, P: Array) -> Array:
    return jnp.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)


@jax.custom_jvp
def solve_riccati(
    A: Float[Array, "n n"], B: Float[Array, "n m"], Q: Float[Array, "n n"], R: Float[Array, "m m"]
) -> Float[Array, "n n"]:
    """Stabilising solution P of `P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q`, differentiable in all arguments.

    Structure-preserving doubling, quadratically convergent (Chu, Fan, Lin, Wang, 2004). The derivative is that of the
    equation, not of the iteration.
    """
    identity = jnp.eye(A.shape[0], dtype=A.dtype)

    def double(carry: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], None]:
        A, G, H = carry
        solved = jnp.linalg.solve(identity + G @ H, jnp.concatenate([A, G], axis=1))
        WA, WG = solved[:, : A.shape[0]], solved[:, A.shape[0] :]
        return (A @ WA, G + A @ WG @ A.T, H + A.T @ H @ WA), None

    start = (A, B @ jnp.linalg.solve(R, B.T), Q)
    (_, _, H), _ = jax.lax.scan(double, start, None, length=_DOUBLINGS)
    return 0.5 * (H + H.T)


@solve_riccati.defjvp
def _riccati_jvp(primals: tuple[ArrayLike, ...], tangents: tuple[ArrayLike, ...]) -> tuple[Array, Array]:
    """The optimal gain K does not change P to first order, so only `P = Q + K'RK + (A - BK)'P(A - BK)` counts."""
    A, B, Q, R = map(jnp.asarray, primals)
    dA, dB, dQ, dR = map(jnp.asarray, tangents)
    P = solve_riccati(A, B, Q, R)
    K = _optimal_gain(A, B, R, P)
    closed_loop = A - B @ K
    half_change = closed_loop.T @ P @ (dA - dB @ K)
    return P, _solve_lyapunov(closed_loop, dQ + K.T @ dR @ K + half_change + half_change.T)


def _solve_lyapunov(F: Float[Array, "n n"], S: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """X of `X = F'XF + S` for a stable F, by doubling (Smith, 1968)."""

    def double(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        X, F = carry
        return (X + F.T @ X @ F, F @ F), None

    return jax.lax.scan(double, (S, F), None, length=_DOUBLINGS)[0][0]
