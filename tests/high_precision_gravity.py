"""Reference gravity in sixty-digit arithmetic, from the potential alone."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from decimal import Context, Decimal, localcontext

import numpy as np
from numpy_reference import J2, MU, RADIUS

ZONALS = tuple(Decimal(J) for J in (J2, -2.53265649e-6, -1.61962159e-6, -2.27296083e-7, 5.40681239e-7))
"""J2 to J6 of the Earth."""

_STEP = Decimal("1e-9")
"""Step of the central difference [m]; its error is (step / r)^2 = 1e-32, and rounding leaves thirty digits."""

DecimalVector = list[Decimal]


def sixty_digits() -> AbstractContextManager[Context]:
    """Arithmetic with sixty digits."""
    return localcontext(prec=60)


def potential(r: DecimalVector, degree: int, zonals: tuple[Decimal, ...] = ZONALS) -> Decimal:
    """Potential [m^2/s^2] of the Earth with zonal harmonics up to `degree`."""
    distance = sum(x * x for x in r).sqrt()
    sine = r[2] / distance
    legendre = [Decimal(1), sine]
    for n in range(1, degree):
        legendre.append(((2 * n + 1) * sine * legendre[n] - n * legendre[n - 1]) / (n + 1))
    oblate = sum(zonals[n - 2] * (Decimal(RADIUS) / distance) ** n * legendre[n] for n in range(2, degree + 1))
    return Decimal(MU) / distance * (1 - oblate)


def potential_gradient(r: DecimalVector, degree: int, zonals: tuple[Decimal, ...] = ZONALS) -> DecimalVector:
    """Acceleration [m/s^2]: central differences of the potential, good to thirty digits."""
    found = []
    for axis in range(3):
        ahead, behind = list(r), list(r)
        ahead[axis] += _STEP
        behind[axis] -= _STEP
        found.append((potential(ahead, degree, zonals) - potential(behind, degree, zonals)) / (2 * _STEP))
    return found


def field_difference(field: Callable[[DecimalVector], DecimalVector], r: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Field at `r + d` less the field at `r`."""
    with sixty_digits():
        near = [Decimal(float(x)) for x in r]
        far = [x + Decimal(float(y)) for x, y in zip(near, d, strict=True)]
        return np.array([float(a - b) for a, b in zip(field(far), field(near), strict=True)])
