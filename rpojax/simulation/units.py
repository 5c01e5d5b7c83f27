"""Units in scenario keys: `tumble_rate_deg_s` in a file is the leaf `tumble_rate` [rad/s] inside."""

import math
from typing import Final

_DEGREE = math.pi / 180.0

FACTORS: Final[dict[str, float]] = {
    "_deg_sqrt_s": _DEGREE,
    "_deg_s_sqrt_s": _DEGREE,
    "_mrad_s2": 1e-3,
    "_m_s2_sqrt_hz": 1.0,
    "_deg_s": _DEGREE,
    "_kg_m2": 1.0,
    "_kg_m3": 1.0,
    "_n_m_s": 1.0,
    "_w_m2": 1.0,
    "_rad_s": 1.0,
    "_mm_s": 1e-3,
    "_n_m": 1.0,
    "_m2": 1.0,
    "_m_s": 1.0,
    "_deg": _DEGREE,
    "_px": 1.0,
    "_kg": 1.0,
    "_m": 1.0,
    "_n": 1.0,
    "_s": 1.0,
}
"""Unit suffix of a scenario key -> factor to SI and radians, longest suffixes first."""


def split(key: str) -> tuple[str, float]:
    """Name without its unit suffix, and the factor from the user's unit to SI and radians."""
    for suffix, factor in FACTORS.items():
        if key.endswith(suffix):
            return key.removesuffix(suffix), factor
    return key, 1.0
