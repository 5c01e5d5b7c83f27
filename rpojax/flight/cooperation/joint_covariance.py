"""Covariance of the motion of several bodies and of slow errors, kept as blocks that stay symmetric to the last bit.

The state is ordered by kind: positions of all bodies (3 each), their velocities (3 each), then the slow errors. Every
operation gives symmetric blocks by its form: a full matrix that is only nearly symmetric loses its definiteness, since
the antisymmetric part of its rounding grows with the free motion and no measurement reduces it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.kalman_update import SequentialGains
from rpojax.core.pytree import pytree
from rpojax.core.vectors import product

Matrix = Float[Array, "3 3"]


@pytree
class JointCovariance:
    """Blocks of a covariance of `b` bodies and `q` slow errors.

    Attributes:
        xx: (3 b, 3 b) of positions [m^2]
        xv: (3 b, 3 b) of positions with velocities
        xs: (3 b, q) of positions with slow errors
        vv: (3 b, 3 b) of velocities
        vs: (3 b, q) of velocities with slow errors
        ss: (q, q) of slow errors
    """

    xx: Array
    xv: Array
    xs: Array
    vv: Array
    vs: Array
    ss: Array

    @property
    def position_rows(self) -> Float[Array, "x n"]:
        """Rows of the positions."""
        return jnp.concatenate([self.xx, self.xv, self.xs], axis=1)

    @property
    def velocity_rows(self) -> Float[Array, "x n"]:
        """Rows of the velocities."""
        return jnp.concatenate([self.xv.T, self.vv, self.vs], axis=1)

    def slow_rows(self, chosen: slice) -> Float[Array, "count n"]:
        """Rows of some slow errors."""
        return jnp.concatenate([self.xs[:, chosen].T, self.vs[:, chosen].T, self.ss[chosen]], axis=1)

    @property
    def matrix(self) -> Float[Array, "n n"]:
        """The whole covariance."""
        return jnp.concatenate([self.position_rows, self.velocity_rows, self.slow_rows(slice(None))], axis=0)

    def of_body(self, body: int, slow: int) -> Float[Array, "n n"]:
        """Covariance of one body's position and velocity with the first `slow` slow errors."""
        own = slice(3 * body, 3 * body + 3)
        xs, vs = self.xs[own, :slow], self.vs[own, :slow]
        rows = [
            [self.xx[own, own], self.xv[own, own], xs],
            [self.xv[own, own].T, self.vv[own, own], vs],
            [xs.T, vs.T, self.ss[:slow, :slow]],
        ]
        return jnp.concatenate([jnp.concatenate(row, axis=1) for row in rows], axis=0)


def from_matrix(P: Float[Array, "n n"], bodies: int) -> JointCovariance:
    """Blocks of a covariance in the order of `JointCovariance`."""
    v, s = 3 * bodies, 6 * bodies
    return JointCovariance(xx=P[:v, :v], xv=P[:v, v:s], xs=P[:v, s:], vv=P[v:s, v:s], vs=P[v:s, s:], ss=P[s:, s:])


def of_each_body(matrix: Matrix, rows: Float[Array, "x k"]) -> Float[Array, "x k"]:
    """Product of a matrix with the three rows of each body."""
    return jnp.concatenate([product(matrix, rows[first : first + 3]) for first in range(0, rows.shape[0], 3)], axis=0)


def propagate(
    P: JointCovariance,
    gravity_gradient: Matrix,
    velocity_process_covariance: Float[Array, "x x"],
    decay: Float[Array, " q"],
    slow_process_variance: Float[Array, " q"],
    dt: float,
) -> JointCovariance:
    """Covariance after `dt` [s] of free motion of all bodies in one gravity gradient [1/s^2], as `orbit_covariance`.

    `decay` [-] is the factor on each slow error; the process noises are those of the step.
    """
    kick = dt * gravity_gradient
    kicked = P.xv + of_each_body(kick, P.xx).T
    half = of_each_body(kick, 0.5 * (P.xv + kicked))
    vv = P.vv + (half + half.T)
    vs = (P.vs + of_each_body(kick, P.xs)) * decay[None, :]
    return JointCovariance(
        xx=P.xx + dt * (kicked + kicked.T) + dt * dt * vv,
        xv=kicked + dt * vv,
        xs=P.xs * decay[None, :] + dt * vs,
        vv=vv + velocity_process_covariance,
        vs=vs,
        ss=P.ss * (decay[:, None] * decay[None, :]) + jnp.diag(slow_process_variance),
    )


def scaled(P: JointCovariance, motion: Float[Array, " x"], slow: Float[Array, " q"]) -> JointCovariance:
    """Covariance of a state multiplied by factors: each body's position and velocity by `motion`, the slow errors."""
    both = motion[:, None] * motion[None, :]
    mixed = motion[:, None] * slow[None, :]
    return JointCovariance(
        xx=P.xx * both,
        xv=P.xv * both,
        xs=P.xs * mixed,
        vv=P.vv * both,
        vs=P.vs * mixed,
        ss=P.ss * (slow[:, None] * slow[None, :]),
    )


def reduced(P: JointCovariance, gains: SequentialGains) -> JointCovariance:
    """Covariance after the measurements of these gains."""
    x, s = P.xx.shape[0], 2 * P.xx.shape[0]
    for factor, vector in zip(gains.factors, gains.vectors, strict=True):
        of_x, of_v, of_s = vector[:x], vector[x:s], vector[s:]
        by_x, by_v = factor * of_x, factor * of_v
        P = JointCovariance(
            xx=P.xx - factor * (of_x[:, None] * of_x[None, :]),
            xv=P.xv - by_x[:, None] * of_v[None, :],
            xs=P.xs - by_x[:, None] * of_s[None, :],
            vv=P.vv - factor * (of_v[:, None] * of_v[None, :]),
            vs=P.vs - by_v[:, None] * of_s[None, :],
            ss=P.ss - factor * (of_s[:, None] * of_s[None, :]),
        )
    return P


def scaled_slow(P: JointCovariance, factors: Float[Array, " q"]) -> JointCovariance:
    """Covariance of a state whose slow errors are multiplied by factors."""
    return JointCovariance(
        xx=P.xx,
        xv=P.xv,
        xs=P.xs * factors[None, :],
        vv=P.vv,
        vs=P.vs * factors[None, :],
        ss=P.ss * (factors[:, None] * factors[None, :]),
    )
