"""Unit suffixes of scenario keys: `tumble_rate_deg_s` becomes the parameter `tumble_rate` [rad/s]."""

import math
from typing import Final

_DEGREE = math.pi / 180.0

SI_FACTORS: Final[dict[str, float]] = {
    "_deg_sqrt_s": _DEGREE,
    "_deg_s_sqrt_s": _DEGREE,
    "_mrad_s2": 1e-3,
    "_sqrt_s": 1.0,
    "_m_s2_sqrt_hz": 1.0,
    "_deg_h": _DEGREE / 3600.0,
    "_deg_s": _DEGREE,
    "_m2_kg": 1.0,
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
"""Factor to SI and radians by unit suffix, longest suffixes first."""


def split_unit(key: str) -> tuple[str, float]:
    """Name of a key without its unit suffix, and the factor from its unit to SI and radians."""
    for suffix, factor in SI_FACTORS.items():
        if key.endswith(suffix):
            return key.removesuffix(suffix), factor
    return key, 1.0


_UNIT_SYMBOLS: Final[dict[str, str]] = {
    "_deg_sqrt_s": "deg/sqrt(s)",
    "_deg_s_sqrt_s": "deg/s/sqrt(s)",
    "_mrad_s2": "mrad/s2",
    "_sqrt_s": "1/sqrt(s)",
    "_m_s2_sqrt_hz": "m/s2/sqrt(Hz)",
    "_deg_h": "deg/h",
    "_deg_s": "deg/s",
    "_m2_kg": "m2/kg",
    "_kg_m2": "kg m2",
    "_kg_m3": "kg/m3",
    "_n_m_s": "N m s",
    "_w_m2": "W/m2",
    "_rad_s": "rad/s",
    "_mm_s": "mm/s",
    "_n_m": "N m",
    "_m2": "m2",
    "_m_s": "m/s",
    "_deg": "deg",
    "_px": "pixel",
    "_kg": "kg",
    "_m": "m",
    "_n": "N",
    "_s": "s",
}


def unit_symbol(key: str) -> str:
    """Symbol of a key's unit, such as `kg m2`; `1` for a dimensionless number."""
    return next((_UNIT_SYMBOLS[suffix] for suffix in SI_FACTORS if key.endswith(suffix)), "1")
