"""Multiplicative extended Kalman filter of the target's attitude and rate, as blocks of the relative orbit filter.

The error `a` is a small turn in the target's axes, `q_true = exp(a) q_reference`: the slow state `attitude`, which the
prediction folds into the reference. The target turns free of torque but for the gravity gradient; the ratios of its
moments of inertia and the place of its centre of mass are states, too. Lefferts, Markley, Shuster, "Kalman Filtering
for Spacecraft Attitude Estimation", 1982.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.constants import MU_EARTH
from rpojax.core.filter_state_layout import StateLayout
from rpojax.core.numerics import gradient_safe, runge_kutta
from rpojax.core.numerics.short_scan import short_scan
from rpojax.core.numerics.small_systems import inverse_positive_definite
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, cross, product
from rpojax.flight.navigation import symmetric_attitudes
from rpojax.flight.navigation.symmetric_attitudes import BodySymmetries

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Matrix = Float[Array, "3 3"]


@pytree
class BelievedTarget:
    """What flight software knows of the target's body.

    Attributes:
        inertia: (3, 3) about the centre of mass, T; only its ratios count [kg m^2]
        landmarks: (n, 3) in T, from where the centre of mass is thought to be [m]
        symmetries: turns that exchange landmarks, None of a body that looks alike in no other attitude
    """

    inertia: Array
    landmarks: Array
    symmetries: BodySymmetries | None = None


@pytree
class TargetAttitude:
    """Attitude of the target that the errors of the filter are measured from.

    Attributes:
        q_TN: (4,)
        inertia: (3, 3) as in `BelievedTarget`
        known: () bool, it was found and has not been lost
        unexplained_s: () for how long landmarks have contradicted it, less the time for which they agreed [s]
        votes: (s,) pictures that speak for each attitude in which the target looks alike, this one first; None of a
            body that looks alike in no other
        agreed: () number of pictures without common errors that have agreed with it, None but of a landmark network
    """

    q_TN: Array
    inertia: Array
    known: Array
    unexplained_s: Array
    votes: Array | None = None
    agreed: Array | None = None

    @property
    def certain(self) -> Bool[Array, ""]:
        """Whether it is known, told from all others in which the target looks alike, and not by one wrong picture."""
        certain = self.known
        if self.votes is not None:
            certain = certain & symmetric_attitudes.is_certain(self.votes)
        return certain if self.agreed is None else certain & (self.agreed >= _INDEPENDENT_PICTURES)


def unknown(target: BelievedTarget, by_network: bool = False) -> TargetAttitude:
    """Before it was found."""
    zero, alike = jnp.zeros_like(target.inertia[0, 0]), target.symmetries
    return TargetAttitude(
        q_TN=jnp.array([1.0, 0.0, 0.0, 0.0], dtype=zero.dtype),
        inertia=target.inertia,
        known=jnp.zeros((), dtype=bool),
        unexplained_s=zero,
        votes=None if alike is None else jnp.zeros(alike.turns.shape[0], dtype=zero.dtype),
        agreed=zero if by_network else None,
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
    q_TN, rate, inertia = attitude(reference, slow), slow["rate"], inertia_of(reference.inertia, slow["inertia_ratio"])
    inverse, distance = inverse_positive_definite(inertia), gradient_safe.norm(r_TN_N)
    outward_N, pull = r_TN_N / distance, 3.0 * MU_EARTH / distance**3

    def derivative(y: tuple[Array, Vector], _: Scalar | None) -> tuple[Array, Vector]:
        q, omega = y
        return quaternion.derivative(q, omega), apply(inverse, _torque(inertia, q, omega, outward_N, pull))

    change_q, change_rate = runge_kutta.increment("rk4", derivative, (q_TN, rate), None, dt)
    by_rate = product(inverse, cross_matrix(apply(inertia, rate)) - product(cross_matrix(rate), inertia))
    by_ratio = _effect_of_ratios(inertia, inverse, quaternion.rotate(q_TN, outward_N), pull, rate)
    known, identity = reference.known, jnp.eye(3, dtype=P.dtype)
    # What is not known does not become less known by turning on.
    turned, shown, by_rate, by_ratio = (
        jnp.where(known, each, otherwise)
        for each, otherwise in (
            (_turned(rate, dt), identity),
            (_shown_by_rate(rate, dt), 0.0),
            (identity + dt * by_rate, identity),
            (dt * by_ratio, 0.0),
        )
    )
    P = _mixed(P, layout, (turned, shown), by_rate, by_ratio)
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


def _torque(inertia: Matrix, q_TN: Array, omega_TN_T: Vector, outward_N: Vector, pull: Scalar) -> Vector:
    """Gyroscopic torque and that of the gravity gradient of strength `pull` [1/s^2], in T and the inertia's unit."""
    outward = quaternion.rotate(q_TN, outward_N)
    return pull * cross(outward, apply(inertia, outward)) - cross(omega_TN_T, apply(inertia, omega_TN_T))


def _effect_of_ratios(
    inertia: Matrix, inverse: Matrix, outward: Vector, pull: Scalar, rate: Vector
) -> Float[Array, "3 2"]:
    """Angular acceleration by a unit of each log of a ratio of moments [rad/s^2]; `outward` from the Earth, in T."""
    torque = pull * cross(outward, apply(inertia, outward)) - cross(rate, apply(inertia, rate))
    acceleration, columns = apply(inverse, torque), []
    for axis in range(2):
        row = 0.5 * inertia[axis]
        of_axis = jnp.zeros_like(row).at[axis].set(1.0)

        def change(vector: Vector, row: Vector = row, of_axis: Vector = of_axis) -> Vector:
            """Product of the change of the inertia and a vector."""
            return of_axis * jnp.sum(row * vector, axis=0) + row * jnp.sum(of_axis * vector, axis=0)

        added = pull * cross(outward, change(outward)) - cross(rate, change(rate)) - change(acceleration)
        columns.append(apply(inverse, added))
    return jnp.stack(columns, axis=1)


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
    assert angle.stop == rate.start

    def change(rows: Array, _: Array) -> tuple[Array, None]:
        turned = product(of_attitude[0], rows[angle]) + product(of_attitude[1], rows[rate])
        changed = product(by_rate, rows[rate]) + product(by_ratio, rows[ratio])
        return jnp.concatenate([rows[: angle.start], turned, changed, rows[rate.stop :]]).T, None

    # Rows, then columns.
    return short_scan(change, P, jnp.arange(2))


def given_up(
    reference: TargetAttitude,
    variance: Float[Array, "3"],
    used: Bool[Array, ""],
    contradicted: Bool[Array, ""],
    dt: float,
    renewal: Scalar | None = None,
) -> tuple[TargetAttitude, Bool[Array, ""]]:
    """Reference `dt` [s] after the tick before, and whether the attitude was given up.

    That is where landmarks contradict it, and where its error, of that `variance` (3,), is too large for the filter to
    be linear: from the next pictures a first pose is surer. Of a network of whose errors a share `renewal` is new in
    each picture, pictures with the same errors contradict a certain attitude once.
    """
    counts = jnp.full_like(variance[0], dt)
    if renewal is not None:
        counts = jnp.where(reference.certain, _LOST_AFTER / _INDEPENDENT_PICTURES * renewal, counts)
    change = jnp.where(contradicted & reference.known, counts, 0.0) - jnp.where(used, counts, 0.0)
    unexplained = jnp.maximum(reference.unexplained_s + change, 0.0)
    doubtful = jnp.max(variance, axis=0) > LARGEST_SIGMA**2
    lost = reference.known & ((unexplained >= _LOST_AFTER) | doubtful)
    known = reference.known & ~lost
    return replace(reference, known=known, unexplained_s=jnp.where(lost, 0.0, unexplained)), lost


def agreed_after(reference: TargetAttitude, used: Bool[Array, ""], renewal: Scalar | None) -> TargetAttitude:
    """Reference after a picture of which a share `renewal` () of the errors is new, and that may have been used."""
    if reference.agreed is None or renewal is None:
        return reference
    more = reference.agreed + jnp.where(used & reference.known, renewal, 0.0)
    return replace(reference, agreed=jnp.where(reference.known, more, 0.0))


_INDEPENDENT_PICTURES = 3.0
"""Pictures with errors of their own that have to agree with an attitude until it is certain. Of a network that takes
one picture in twenty for that of a turned target, in false views of 17 to 21 deg, one wrong first pose in a thousand to
seven thousand passes."""
_LOST_AFTER = 10.0
"""Time for which landmarks contradict the attitude longer than they agree, until it is looked for anew [s]. A wrong one
is in agreement with chance landmarks every now and then."""
LARGEST_SIGMA = 0.2
"""Largest 1 sigma of a component of the attitude error that a linear update is for [rad]."""
