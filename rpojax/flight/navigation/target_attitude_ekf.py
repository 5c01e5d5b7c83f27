"""Multiplicative extended Kalman filter of the target's attitude and rate, as blocks of the relative orbit filter.

The error `a` is a small turn in the target's axes, `q_true = exp(a) q_reference`: the slow state `attitude`, which the
prediction folds into the reference. The target turns free of torque but for the gravity gradient; the ratios of its
moments of inertia and the place of its centre of mass are states, too. Lefferts, Markley, Shuster, "Kalman Filtering
for Spacecraft Attitude Estimation", 1982.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.constants import MU_EARTH
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.numerics import gradient_safe, runge_kutta
from rpojax.core.numerics.small_systems import solve_positive_definite
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, cross, product

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]


@pytree
class BelievedTarget:
    """What flight software knows of the target's body.

    Attributes:
        inertia: (3, 3) about the centre of mass, T; only its ratios count [kg m^2]
        landmarks: (n, 3) in T, from where the centre of mass is thought to be [m]
    """

    inertia: Array
    landmarks: Array


@pytree
class TargetAttitude:
    """Attitude of the target that the errors of the filter are measured from.

    Attributes:
        q_TN: (4,)
        inertia: (3, 3) as in `BelievedTarget`
        known: () bool, it was found and has not been lost
        unexplained_s: () for how long landmarks have contradicted it [s]
    """

    q_TN: Array
    inertia: Array
    known: Array
    unexplained_s: Array


def unknown(target: BelievedTarget) -> TargetAttitude:
    """Before it was found."""
    zero = jnp.zeros_like(target.inertia[0, 0])
    return TargetAttitude(
        q_TN=jnp.array([1.0, 0.0, 0.0, 0.0], dtype=zero.dtype),
        inertia=target.inertia,
        known=jnp.zeros((), dtype=bool),
        unexplained_s=zero,
    )


def attitude(reference: TargetAttitude, slow: dict[str, Array]) -> Float[Array, "4"]:
    """Estimated `q_TN`."""
    return quaternion.multiply(quaternion.exp(slow["attitude"]), reference.q_TN)


def inertia_of(nominal: Matrix, ratios: Float[Array, "2"]) -> Matrix:
    """Inertia (3, 3) whose moments about the first two axes are larger by factors of which `ratios` are the logs."""
    scale = jnp.exp(0.5 * jnp.concatenate([ratios, jnp.zeros_like(ratios[:1])]))
    return scale[:, None] * nominal * scale[None, :]


def predict(
    reference: TargetAttitude, layout: StateLayout, slow: dict[str, Array], P: Array, r_TN_N: Vector, dt: float
) -> tuple[TargetAttitude, dict[str, Array], Float[Array, "n n"]]:
    """Reference, slow states and covariance `dt` [s] later, without process noise; the target is at `r_TN_N` [m]."""
    q_TN, rate, ratios = attitude(reference, slow), slow["rate"], slow["inertia_ratio"]

    def acceleration(q: Array, omega: Vector, ratios: Array) -> Vector:
        inertia = inertia_of(reference.inertia, ratios)
        return solve_positive_definite(inertia, _torque(inertia, q, omega, r_TN_N))

    def derivative(y: tuple[Array, Vector], _: Scalar | None) -> tuple[Array, Vector]:
        return quaternion.derivative(*y), acceleration(*y, ratios)

    change_q, change_rate = runge_kutta.increment("rk4", derivative, (q_TN, rate), None, dt)
    by_rate, by_ratio = jax.jacfwd(lambda omega, log: acceleration(q_TN, omega, log), argnums=(0, 1))(rate, ratios)
    transition = (_turned(rate, dt), _shown_by_rate(rate, dt))
    P = _mixed(P, layout, transition, jnp.eye(3, dtype=P.dtype) + dt * by_rate, dt * by_ratio)
    known = reference.known
    q_TN = jnp.where(known, quaternion.normalize(q_TN + change_q), reference.q_TN)
    rate = jnp.where(known, rate + change_rate, rate)
    none = jnp.zeros_like(slow["attitude"])
    return replace(reference, q_TN=q_TN), {**slow, "attitude": none, "rate": rate}, P


def turned_by(
    reference: TargetAttitude, layout: StateLayout, slow: dict[str, Array], P: Array, dt: Scalar
) -> tuple[TargetAttitude, dict[str, Array], Float[Array, "n n"]]:
    """Reference, slow states and covariance a short time `dt` [s] later or earlier, in which the rate stays."""
    rate, none = slow["rate"], jnp.zeros_like(slow["attitude"])
    moved = quaternion.multiply(quaternion.exp(-dt * rate), attitude(reference, slow))
    identity, by_ratio = jnp.eye(3, dtype=P.dtype), jnp.zeros((3, 2), dtype=P.dtype)
    P = _mixed(P, layout, (_turned(rate, dt), _shown_by_rate(rate, dt)), identity, by_ratio)
    return replace(reference, q_TN=moved), {**slow, "attitude": none}, P


def _torque(inertia: Matrix, q_TN: Array, omega_TN_T: Vector, r_TN_N: Vector) -> Vector:
    """Gyroscopic torque and that of the gravity gradient in T, over the unit of the inertia [1/s^2]."""
    r_T = quaternion.rotate(q_TN, r_TN_N)
    distance = gradient_safe.norm(r_T)
    outward = r_T / distance
    gradient = 3.0 * MU_EARTH / distance**3 * cross(outward, apply(inertia, outward))
    return gradient - cross(omega_TN_T, apply(inertia, omega_TN_T))


def _turned(rate: Vector, dt: float | Scalar) -> Matrix:
    """Error of the attitude after a turn by a unit of each before it."""
    return quaternion.to_matrix(quaternion.exp(-dt * rate))


def _shown_by_rate(rate: Vector, dt: float | Scalar) -> Matrix:
    """Error of the attitude after `dt` [s] by a unit of each error of the rate [s]."""
    return -dt * (jnp.eye(3, dtype=rate.dtype) - 0.5 * dt * cross_matrix(rate))


def cross_matrix(vector: Vector) -> Matrix:
    """Matrix of the cross product from the left."""
    x, y, z = vector[0], vector[1], vector[2]
    zero = jnp.zeros_like(x)
    return jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])


def _mixed(
    P: Float[Array, "n n"], layout: StateLayout, of_attitude: tuple[Matrix, Matrix], by_rate: Matrix, by_ratio: Array
) -> Float[Array, "n n"]:
    """Covariance after a linear change of attitude error and rate by themselves, rate and inertia ratios."""
    angle, rate, ratio = layout["attitude"], layout["rate"], layout["inertia_ratio"]

    def change(rows: Array) -> Array:
        turned = product(of_attitude[0], rows[angle]) + product(of_attitude[1], rows[rate])
        changed = product(by_rate, rows[rate]) + product(by_ratio, rows[ratio])
        return rows.at[angle].set(turned).at[rate].set(changed)

    return change(change(P).T).T


def is_lost(reference: TargetAttitude, used: Bool[Array, ""], rejected: Bool[Array, ""], dt: Scalar) -> TargetAttitude:
    """Reference that is given up where landmarks have contradicted it for long, `dt` [s] after the tick before."""
    unexplained = jnp.where(used, 0.0, reference.unexplained_s + jnp.where(rejected & reference.known, dt, 0.0))
    lost = unexplained >= _LOST_AFTER
    return replace(reference, known=reference.known & ~lost, unexplained_s=jnp.where(lost, 0.0, unexplained))


_LOST_AFTER = 10.0
"""Time of landmarks that contradict the attitude without one that agrees, after which it is looked for anew [s]."""
