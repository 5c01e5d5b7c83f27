"""Rounding error of the shadow formula that Basilisk uses, so that it is not taken for an error of the package."""

import math
from typing import Any

import numpy as np


def arc_cosine_rounding(r: np.ndarray, r_sun: np.ndarray, radius: float, sun_radius: float) -> float:
    """Error of the lit share of the Sun when overlapping discs are computed with arc cosines in double precision.

    The Earth's disc is so much larger than the Sun's that its arc cosine is taken 1e-5 below 1, where rounding of the
    argument costs half of the digits. Zero on machines that have nothing longer than a double to compare with.
    """
    # The library's functions, number by number, round as Basilisk's do; vectorised ones need not.
    short = _lit_share(r, r_sun, radius, sun_radius, math)
    long = _lit_share(r.astype(np.longdouble), r_sun.astype(np.longdouble), radius, sun_radius, np)
    return float(short - long)


def _lit_share(r: np.ndarray, r_sun: np.ndarray, radius: float, sun_radius: float, functions: Any) -> Any:
    number = float if functions is math else np.longdouble
    arcsine = functions.asin if functions is math else functions.arcsin
    arccosine = functions.acos if functions is math else functions.arccos
    to_sun = r_sun - r
    far, near = (number(functions.sqrt(number(np.sum(vector * vector)))) for vector in (to_sun, r))
    a, b = arcsine(number(sun_radius) / far), arcsine(number(radius) / near)
    c = arccosine(-number(np.sum(r * to_sun)) / near / far)
    if not abs(a - b) < c < a + b:
        return number(0.0)
    x = (c * c + a * a - b * b) / (2 * c)
    overlap = a * a * arccosine(x / a) + b * b * arccosine((c - x) / b) - c * functions.sqrt(a * a - x * x)
    return 1 - overlap / (math.pi * a * a)
