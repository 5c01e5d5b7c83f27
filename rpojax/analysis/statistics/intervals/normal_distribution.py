"""Probabilities of a standard normal number."""

import math
from typing import Final

from scipy.special import erf

Z_95: Final = 1.96
"""Half-width of the 95 % interval of a standard normal number, rounded as in tables."""


def coverage_per_axis(sigmas: float) -> float:
    """Probability that a normal error lies within so many of its standard deviations."""
    return float(erf(sigmas / math.sqrt(2.0)))
