"""Rotations from the frames of orbit messages to the scenario's inertial frame, EME2000.

By the routines of ERFA: precession of 1976 and nutation of 1980, to which TEME belongs, and the frame bias of 2006.
"""

import math
from typing import Final

import erfa
import numpy as np

from rpojax.errors import ScenarioError
from rpojax.time_scales import Instant

SAME: Final = ("EME2000", "J2000")
"""Names of the scenario's inertial frame."""
KNOWN: Final = (*SAME, "GCRF", "ICRF", "TOD", "TEME")
"""Frames that are converted."""
_J2000_DAY: Final = 2451545.0


def to_inertial(frame: str, epoch: Instant, key: str) -> np.ndarray:
    """Rotation (3, 3) from the axes of a frame at an epoch to those of N; `key` names the file in errors.

    Raises:
        ScenarioError: the frame is not known.
    """
    name = frame.upper()
    if name not in KNOWN:
        raise ScenarioError(key, f"the frame {frame:.30}", f"one of {', '.join(KNOWN)}")
    if name in SAME:
        return np.eye(3)
    days = epoch.terrestrial_s / 86400.0
    if name in ("GCRF", "ICRF"):
        bias, *_ = erfa.bp06(_J2000_DAY, 0.0)
        return np.asarray(bias)
    from_true_of_date = np.asarray(erfa.pnm80(_J2000_DAY, days)).T
    return from_true_of_date @ (_from_mean_equinox(days) if name == "TEME" else np.eye(3))


def _from_mean_equinox(days: float) -> np.ndarray:
    """Rotation from the true equator and mean equinox to the true equator and equinox of date."""
    angle = float(erfa.eqeq94(_J2000_DAY, days))
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
