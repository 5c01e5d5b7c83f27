"""Unit suffixes of scenario keys: `tumble_rate_deg_s` becomes the parameter `tumble_rate` [rad/s]."""

import math
from typing import Final

_DEGREE = math.pi / 180.0

UNITS: Final[dict[str, tuple[str, float]]] = {
    "_deg_sqrt_s": ("deg/sqrt(s)", _DEGREE),
    "_deg_s_sqrt_s": ("deg/s/sqrt(s)", _DEGREE),
    "_mrad_s2": ("mrad/s2", 1e-3),
    "_sqrt_s": ("1/sqrt(s)", 1.0),
    "_m_s2_sqrt_hz": ("m/s2/sqrt(Hz)", 1.0),
    "_deg_h": ("deg/h", _DEGREE / 3600.0),
    "_deg_s": ("deg/s", _DEGREE),
    "_m2_kg": ("m2/kg", 1.0),
    "_kg_m2": ("kg m2", 1.0),
    "_kg_m3": ("kg/m3", 1.0),
    "_n_m_s": ("N m s", 1.0),
    "_w_m2": ("W/m2", 1.0),
    "_rad_s": ("rad/s", 1.0),
    "_mm_s": ("mm/s", 1e-3),
    "_n_m": ("N m", 1.0),
    "_m2": ("m2", 1.0),
    "_m_s": ("m/s", 1.0),
    "_deg": ("deg", _DEGREE),
    "_px": ("pixel", 1.0),
    "_kg": ("kg", 1.0),
    "_m": ("m", 1.0),
    "_n": ("N", 1.0),
    "_s": ("s", 1.0),
}
"""Symbol, and factor to SI and radians, by unit suffix, longest suffixes first."""


def split_unit(key: str) -> tuple[str, float]:
    """Name of a key without its unit suffix, and the factor from its unit to SI and radians."""
    for suffix, (_, factor) in UNITS.items():
        if key.endswith(suffix):
            return key.removesuffix(suffix), factor
    return key, 1.0


def unit_symbol(key: str) -> str:
    """Symbol of a key's unit, such as `kg m2`; `1` for a dimensionless number."""
    return next((symbol for suffix, (symbol, _) in UNITS.items() if key.endswith(suffix)), "1")
