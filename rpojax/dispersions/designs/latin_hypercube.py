"""Latin hypercube sampling of the unit cube (McKay, Beckman and Conover, Technometrics 21, 1979)."""

import zlib
from collections.abc import Mapping

import numpy as np

from rpojax.dispersions.coordinate_source import clip_to_open_interval
from rpojax.dispersions.designs.run_range import RunRange

_STREAM = 1
"""Separates the random numbers from those of other designs."""


def latin_hypercube(counts: Mapping[str, int], seed: int, run_range: RunRange) -> dict[str, np.ndarray]:
    """Coordinates (runs, count) in (0, 1) by name, one value of each coordinate in each of `runs` equal intervals.

    Each name has its own random stream, so that adding one leaves the others unchanged.
    """
    coordinates = {}
    for name, count in counts.items():
        if count:
            entropy = [_STREAM, seed, zlib.crc32(name.encode()), run_range.first_run, run_range.runs]
            rng = np.random.default_rng(entropy)
            shape = (run_range.runs, count)
            strata = rng.random(shape).argsort(axis=0)
            coordinates[name] = clip_to_open_interval((strata + rng.random(shape)) / run_range.runs)
    return coordinates
