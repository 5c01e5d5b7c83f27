"""Limit states whose probability of failure is known: of a public benchmark, and others, with answers by quadrature."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array
from scipy.integrate import quad
from scipy.stats import binom, chi2, ncx2, norm
from scipy.stats import t as student


@dataclass(frozen=True)
class Problem:
    """A limit state with its answer.

    Attributes:
        name: of the problem
        limit_state: margins (n,) of standard normal numbers (n, dimension)
        dimension: number of them
        probability: of failure
    """

    name: str
    limit_state: Callable[[Array], Array]
    dimension: int
    probability: float


def four_branch(z: Array) -> Array:
    """Series system of two parabolas and two planes (Waarts 2000)."""
    a, b = z[:, 0], z[:, 1]
    bow, total, gap = 0.1 * (a - b) ** 2, (a + b) / math.sqrt(2.0), 7.0 / math.sqrt(2.0)
    return jnp.min(jnp.stack([3.0 + bow - total, 3.0 + bow + total, a - b + gap, b - a + gap]), axis=0)


def rp22(z: Array) -> Array:
    """One parabola."""
    return 2.5 - (z[:, 0] + z[:, 1]) / math.sqrt(2.0) + 0.1 * (z[:, 0] - z[:, 1]) ** 2


def rp31(z: Array) -> Array:
    """A narrow wedge."""
    return 2.0 - z[:, 1] + 256.0 * z[:, 0] ** 4


def rp14(z: Array) -> Array:
    """Shaft under a moment and a torque: uniform, normal, Gumbel, normal, normal."""
    x1 = 70.0 + 10.0 * ndtr(z[:, 0])
    x2 = 39.0 + 0.1 * z[:, 1]
    scale = 350.0 * math.sqrt(6.0) / math.pi
    x3 = 1500.0 - 0.5772156649015329 * scale - scale * jnp.log(-jnp.log(jnp.clip(ndtr(z[:, 2]), 1e-300, 1.0 - 1e-16)))
    x4 = 400.0 + 0.1 * z[:, 3]
    x5 = 250000.0 + 35000.0 * z[:, 4]
    return x1 - 32.0 / (math.pi * x2**3) * jnp.sqrt(x3**2 * x4**2 / 16.0 + x5**2)


def rp25(z: Array) -> Array:
    """Parallel system of two curves."""
    return jnp.maximum(z[:, 0] ** 2 - 8.0 * z[:, 1] + 16.0, -16.0 * z[:, 0] + z[:, 1] + 32.0)


def rp110(z: Array) -> Array:
    """Margins that lead to the less likely one of two regions."""
    a, b = z[:, 0], z[:, 1]
    first = jnp.where(a <= 3.5, 0.85 - 0.1 * a, 4.0 - a)
    second = jnp.where(b <= 2.0, 2.3 - b, 0.5 - 0.1 * b)
    return jnp.minimum(first, second)


def rp111(z: Array) -> Array:
    """Four regions at equal distances."""
    return 12.5 - jnp.abs(z[:, 0] * z[:, 1])


def rp107(z: Array) -> Array:
    """A plane in ten dimensions."""
    return 5.0 * math.sqrt(10.0) - jnp.sum(z, axis=1)


def rp77(z: Array) -> Array:
    """A margin with a step."""
    x1, x2, x3 = 10.0 + 0.5 * z[:, 0], z[:, 1], 4.0 + z[:, 2]
    return jnp.where(x3 <= 5.0, x1 - x2 - x3, x3 - x2)


def hypersphere(z: Array) -> Array:
    """Outside of a sphere in ten dimensions."""
    return 25.0 - jnp.sum(z**2, axis=1)


def parabola(z: Array) -> Array:
    """One-sided parabola."""
    return 3.0 - z[:, 1] - 0.3 * z[:, 0] ** 2


PUBLIC = (
    Problem("four-branch", four_branch, 2, 2.22280e-3),
    Problem("RP22", rp22, 2, 4.20731e-3),
    Problem("RP31", rp31, 2, 3.22668e-3),
    Problem("RP14", rp14, 5, 7.7285e-4),
    Problem("RP25", rp25, 2, 4.14857e-5),
    Problem("RP110", rp110, 2, 3.19579e-5),
    Problem("RP111", rp111, 2, 8.03509e-7),
    Problem("RP107", rp107, 10, 2.86652e-7),
    Problem("RP77", rp77, 3, 2.69084e-7),
    Problem("10-dimensional hypersphere", hypersphere, 10, 5.3455e-3),
    Problem("one-sided parabola", parabola, 2, 9.73272e-3),
)
"""Problems of the benchmark, with its values."""


def plane(beta: float, dimension: int) -> Problem:
    """A plane across the diagonal."""
    return Problem(
        f"plane in {dimension} dimensions",
        lambda z: beta - jnp.sum(z, axis=1) / math.sqrt(dimension),
        dimension,
        float(norm.sf(beta)),
    )


def _wave(z: Array) -> Array:
    return 3.8 - z[:, 0] + 0.3 * jnp.sin(8.0 * z[:, 1])


def _corner(z: Array) -> Array:
    return 1.8 - jnp.min(z[:, :3], axis=1)


def _bowl(z: Array) -> Array:
    return 3.5 - z[:, 0] - 0.1 * z[:, 1] ** 2


def _undefined_far_out(z: Array) -> Array:
    return jnp.where(z[:, 1] > 6.0, jnp.nan, 4.0 - z[:, 0])


def _average(function: Callable[[float], float]) -> float:
    """Mean of a function of one standard normal number."""
    return float(quad(lambda x: norm.pdf(x) * function(x), -9.0, 9.0, limit=400)[0])


HELD_OUT = (
    plane(3.5, 100),
    plane(4.75, 1),
    Problem("two planes, 20 d", lambda z: 4.2 - jnp.abs(jnp.sum(z[:, :4], axis=1)) / 2.0, 20, 2 * float(norm.sf(4.2))),
    Problem("ten planes, 10 d", lambda z: 4.0 - jnp.max(z, axis=1), 10, float(-np.expm1(10 * np.log(norm.cdf(4.0))))),
    Problem("sphere, 50 d", lambda z: float(chi2.isf(1e-4, 50)) - jnp.sum(z**2, axis=1), 50, 1e-4),
    Problem("corner, 4 d", _corner, 4, float(norm.sf(1.8) ** 3)),
    Problem(
        "ring, 2 d", lambda z: jnp.abs(jnp.linalg.norm(z, axis=1) - 4.5) - 0.1, 2, math.exp(-9.68) - math.exp(-10.58)
    ),
    Problem("wave, 2 d", _wave, 2, _average(lambda y: float(norm.sf(3.8 + 0.3 * math.sin(8.0 * y))))),
    Problem("bowl, 30 d", _bowl, 30, _average(lambda y: float(norm.sf(3.5 - 0.1 * y * y)))),
    Problem(
        "flat, 2 d", lambda z: jnp.where(jnp.sum(z, axis=1) > 5.5, -1.0, 1.0), 2, float(norm.sf(5.5 / math.sqrt(2.0)))
    ),
    Problem(
        "flat, 10 d",
        lambda z: jnp.where(jnp.sum(z, axis=1) > 4.0 * math.sqrt(10.0), -1.0, 1.0),
        10,
        float(norm.sf(4.0)),
    ),
    Problem("steps, 3 d", lambda z: jnp.floor(2.0 * (4.2 - z[:, 0])) / 2.0, 3, float(norm.sf(3.7))),
    Problem("undefined far out, 2 d", _undefined_far_out, 2, float(norm.sf(4.0))),
    Problem(
        "unequal planes, 5 d",
        lambda z: jnp.minimum(3.5 - z[:, 0], 2.0 * (4.0 + z[:, 1])),
        5,
        float(norm.sf(3.5) + norm.sf(4.0)),
    ),
    Problem("never", lambda z: 5.0 + z[:, 0] ** 2, 4, 0.0),
    Problem("always", lambda z: -1.0 - z[:, 0] ** 2, 4, 1.0),
    Problem("frequent", lambda z: 0.5 - z[:, 0], 2, float(norm.sf(0.5))),
)
"""Problems that were once held out; the annealing of proposals was repaired with them."""


def _vote(z: Array) -> Array:
    return 2.4 - jnp.sort(z, axis=1)[:, -4]


def _ratio(z: Array) -> Array:
    return 9.0 * jnp.sqrt(jnp.mean(z[:, 1:] ** 2, axis=1)) - z[:, 0]


def _ball(z: Array) -> Array:
    return jnp.sum((z - 2.0) ** 2, axis=1) - 4.0


def _weighted(z: Array) -> Array:
    weights = 0.8 ** jnp.arange(z.shape[1])
    return 4.1 - z @ (weights / jnp.linalg.norm(weights))


UNSEEN = (
    Problem("four of six, 6 d", _vote, 6, float(binom.sf(3, 6, norm.sf(2.4)))),
    Problem("ratio, 6 d", _ratio, 6, float(student.sf(9.0, 5))),
    Problem("ball around a far point, 8 d", _ball, 8, float(ncx2.cdf(4.0, 8, 32.0))),
    Problem(
        "product, 2 d",
        lambda z: 9.0 - z[:, 0] * z[:, 1],
        2,
        _average(lambda x: float(norm.sf(9.0 / max(abs(x), 1e-9)))),
    ),
    Problem(
        "saddle, 2 d",
        lambda z: 14.0 - z[:, 0] ** 2 + z[:, 1] ** 2,
        2,
        _average(lambda y: 2.0 * float(norm.sf(math.sqrt(14.0 + y * y)))),
    ),
    Problem("one lasting and forty small, 41 d", _weighted, 41, float(norm.sf(4.1))),
    Problem("shell, 3 d", lambda z: 5.0 - jnp.linalg.norm(z, axis=1), 3, float(chi2.sf(25.0, 3))),
    Problem(
        "slope that changes by a thousand, 3 d",
        lambda z: jnp.where(z[:, 0] > 3.0, 1e-3 * (4.3 - z[:, 0]), 1.3e-3 + 3.0 - z[:, 0]),
        3,
        float(norm.sf(4.3)),
    ),
)
"""Problems on which nothing was tuned."""
