"""Allocation of a commanded force and torque to thrusters that can only push: bounded least squares of fixed size.

The shares u of full thrust minimise 1/2 |W (B u - w)|^2 + e c' u within 0 <= u <= 1: the wrench w is met as far as the
bounds let it, and among the shares that meet it the least propellant c is used. An interior-point method takes a fixed
number of Newton steps (Nocedal and Wright, Numerical Optimization, 2006, section 16.6); a step solves a system of the
size of the wrench, as that of the shares is diagonal plus a matrix of rank six.
"""

from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Shares = Float[Array, " n"]
Wrench = Float[Array, "6"]


@pytree
class ThrusterLayout:
    """Thrusters as flight software believes them.

    Attributes:
        wrench: (6, n) force [N] and torque about the centre of mass [N m] of each at full thrust, in B
        cost: (n,) propellant flow at full thrust over the greatest of them [-]
        greatest_flow: () that flow [kg/s]
        scale: (6,) greatest force and greatest torque that one thruster has, by which residuals are divided
        minimum_on_time: (n,) [s]
        authority: () force that they give in any direction without torque [N]
    """

    wrench: Array
    cost: Array
    greatest_flow: Array
    scale: Array
    minimum_on_time: Array
    authority: Array


def layout(wrench: np.ndarray, flow: np.ndarray, minimum_on_time: np.ndarray) -> ThrusterLayout:
    """Layout of thrusters by their `wrench_matrix` (6, n), flows (n,) [kg/s] and shortest pulses (n,) [s].

    In NumPy, as it is made once, when a scenario becomes parameters.
    """
    force, torque = (np.linalg.norm(each, axis=0).max() for each in (wrench[:3], wrench[3:]))
    return ThrusterLayout(
        wrench=jax.device_put(wrench),
        cost=jax.device_put(flow / flow.max()),
        greatest_flow=jax.device_put(flow.max()),
        scale=jax.device_put(np.repeat([force, torque], 3)),
        minimum_on_time=jax.device_put(minimum_on_time),
        authority=jax.device_put(force_authority(wrench)),
    )


def wrench_matrix(force: np.ndarray, direction: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Matrix (6, n) of full forces [N] and torques [N m] of thrusters.

    Args:
        force: (n,) full force [N]
        direction: (n, 3) of the force in B; any length
        position: (n, 3) where it acts, from the centre of mass in B [m]
    """
    force_B = force[:, None] * (direction / np.sqrt(np.sum(direction * direction, axis=1))[:, None])
    return np.concatenate([force_B, np.cross(position, force_B)], axis=1).T


def force_authority(wrench: np.ndarray) -> float:
    """Force that thrusters with a `wrench_matrix` (6, n) give in any direction without torque [N]."""
    # In a direction between the axes there is this share of the least at least.
    return float(axis_authority(wrench)[:, :3].min() / np.sqrt(3.0))


def axis_authority(wrench: np.ndarray) -> np.ndarray:
    """Greatest force [N] or torque [N m] in both directions (2, 6) along each axis of B with nothing else beside it.

    `wrench` (6, n) is a `wrench_matrix`. By linear programming.
    """
    found = np.zeros((2, 6))
    count = wrench.shape[1]
    for row, sign in enumerate((1.0, -1.0)):
        for axis in range(6):
            unit = np.zeros(6)
            unit[axis] = sign
            # Shares of the thrusters, and last what they give along the axis.
            equal = np.concatenate([wrench, -unit[:, None]], axis=1)
            cost = np.concatenate([np.zeros(count), [-1.0]])
            solution = scipy.optimize.linprog(
                cost, A_eq=equal, b_eq=np.zeros(6), bounds=[(0.0, 1.0)] * count + [(0.0, None)]
            )
            found[row, axis] = -solution.fun
    return found


def allocate(thrusters: ThrusterLayout, wrench: Wrench, works: Shares, steps: int = 15) -> Shares:
    """Shares (n,) of full thrust for a force [N] and torque [N m] in B, each in [0, 1].

    Args:
        thrusters: layout
        wrench: (6,) commanded
        works: (n,) 1 for a thruster that may be used, 0 for one that is shut off
        steps: Newton steps; fifteen leave 1e-3 of full authority and 3 % of propellant at worst, thirty what rounding
            does
    """
    A = thrusters.wrench / thrusters.scale[:, None]
    b = wrench / thrusters.scale
    # One that is shut off keeps its place with a bound of almost zero, so that the size is fixed.
    bound = jnp.maximum(works, _CLOSED)
    cost = PROPELLANT_WEIGHT * thrusters.cost

    def newton(state: tuple[Shares, Shares, Shares], _: None) -> tuple[tuple[Shares, Shares, Shares], None]:
        u, low, high = state
        spare = bound - u
        gap = jnp.mean(0.5 * (u * low + spare * high), axis=0)
        target = jnp.maximum(_CENTRING * gap, _LEAST_GAP)
        gradient = _times_transposed(A, _times(A, u) - b) + cost
        # Newton direction of the perturbed optimality conditions, with the multipliers eliminated.
        diagonal = low / u + high / spare
        right = -gradient + target / u - target / spare
        du = _solve(A, diagonal, right)
        dlow = target / u - low - low / u * du
        dhigh = target / spare - high + high / spare * du
        length = jnp.minimum(
            jnp.minimum(_longest(u, du), _longest(spare, -du)), jnp.minimum(_longest(low, dlow), _longest(high, dhigh))
        )
        return (u + length * du, low + length * dlow, high + length * dhigh), None

    start = 0.5 * bound
    ones = jnp.full_like(bound, _FIRST_MULTIPLIER)
    (u, _, _), _ = jax.lax.scan(newton, (start, ones, ones), None, length=steps)
    return jnp.clip(u, 0.0, 1.0) * works


PROPELLANT_WEIGHT: Final = 1e-5
"""Weight of the propellant against the squared residual over full authority [-]: its price is a residual of that size,
below the thousandth that thrusters are known to."""
_CENTRING: Final = 0.1
"""Share of the present gap between bound and multiplier that a step aims at [-]. A choice: with 0.05 some steps are
short, with 0.3 more are needed."""
_STEP_SHARE: Final = 0.99
"""Part of the way to the nearest bound that a step goes at most [-] (Nocedal and Wright, section 16.6)."""
_FIRST_MULTIPLIER: Final = 0.1
"""Multipliers at the start [-]. A choice, between residuals of full authority and the weight of the propellant."""
_LEAST_GAP: Final = 1e-11
"""Gap at which the method stays, before it divides by what rounding leaves of a bound [-]: a residual of 1e-7."""
_CLOSED: Final = 1e-6
"""Bound of a thruster that is shut off, as a share of full thrust, as the method divides by it [-]."""


def _times(A: Float[Array, "6 n"], u: Shares) -> Wrench:
    return jnp.sum(A * u[None, :], axis=1)


def _times_transposed(A: Float[Array, "6 n"], r: Wrench) -> Shares:
    return jnp.sum(A * r[:, None], axis=0)


def _longest(value: Shares, change: Shares) -> Scalar:
    """Longest step, 1 at most, that leaves a part of every positive value."""
    shrinking = change < 0.0
    ratio = jnp.where(shrinking, value / jnp.where(shrinking, -change, 1.0), jnp.inf)
    return jnp.minimum(1.0, _STEP_SHARE * jnp.min(ratio, axis=0))


def _solve(A: Float[Array, "6 n"], diagonal: Shares, right: Shares) -> Shares:
    """Solution of (diag(diagonal) + A' A) x = right, by the identity of Woodbury for the six rows of A."""
    inverse = 1.0 / diagonal
    scaled = A * inverse[None, :]
    small = jnp.sum(scaled[:, None, :] * A[None, :, :], axis=2)
    rhs = _times(scaled, right)
    y = _solve_positive(small, rhs)
    return inverse * (right - _times_transposed(A, y))


def _solve_positive(matrix: Float[Array, "6 6"], rhs: Wrench) -> Wrench:
    """Solution of (1 + matrix) y = rhs for a positive semidefinite matrix, by Cholesky factors written out."""
    size = 6
    L: list[list[Array]] = [[] for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            value = matrix[i, j] + (1.0 if i == j else 0.0) - sum(L[i][k] * L[j][k] for k in range(j))
            L[i].append(jnp.sqrt(value) if i == j else value / L[j][j])
    z: list[Array] = []
    for i in range(size):
        z.append((rhs[i] - sum(L[i][k] * z[k] for k in range(i))) / L[i][i])
    y: list[Array] = [rhs[0]] * size
    for i in reversed(range(size)):
        y[i] = (z[i] - sum(L[k][i] * y[k] for k in range(i + 1, size))) / L[i][i]
    return jnp.stack(y)
