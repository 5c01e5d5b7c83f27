"""Scrambled Sobol sequence in the unit cube."""

from collections.abc import Mapping

import numpy as np
from scipy.stats import qmc

from rpojax.dispersions.coordinate_source import clip_to_open_interval
from rpojax.dispersions.designs.run_range import RunRange

_STREAM = 2
"""Separates the random numbers from those of other designs."""
_BITS = 32


def sobol_sequence(counts: Mapping[str, int], seed: int, run_range: RunRange) -> dict[str, np.ndarray]:
    """Coordinates (runs, count) in (0, 1) by name; run `i` is point `i`, so that more runs leave the earlier unchanged.

    Adding a coordinate changes the scrambling of all.
    """
    total = sum(counts.values())
    if total == 0:
        return {}
    sequence = qmc.Sobol(total, bits=_BITS, rng=np.random.default_rng([_STREAM, seed]))
    if run_range.first_run:
        sequence.fast_forward(run_range.first_run)
    # The first point separately: SciPy warns if the first request is not for a power of two.
    points = np.concatenate([sequence.random(1), sequence.random(run_range.runs - 1)])
    # Points lie at the lower ends of their cells; the centre is inside the open interval.
    points = clip_to_open_interval(points + 0.5 * 2.0**-_BITS)
    ends = np.cumsum(list(counts.values()))
    parts = zip(counts, counts.values(), ends, strict=True)
    return {name: points[:, end - count : end] for name, count, end in parts if count}
