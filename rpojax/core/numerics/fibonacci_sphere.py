"""Directions that are evenly spread over a sphere."""

import math

import numpy as np


def fibonacci_sphere(count: int) -> np.ndarray:
    """Evenly spread unit vectors (3, count).

    Gonzalez, "Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices", 2010.
    """
    number = np.arange(count)
    height = 1.0 - (2.0 * number + 1.0) / count
    angle = number * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height])
