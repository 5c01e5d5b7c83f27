"""Values of scenario keys that each run of a batch has of its own."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def values_of_runs(varied: Mapping[str, np.ndarray], key: str, nominal: Any) -> np.ndarray:
    """Value of a key in every run (runs, ...) where it varies, else the nominal one with one row (1, ...).

    Args:
        varied: key -> (runs, ...) of all keys that vary from run to run, in the unit of the key
        key: whole key, such as `formation.desired_position_m`
        nominal: its value in the scenario
    """
    return np.asarray(varied[key], dtype=np.float64) if key in varied else np.asarray(nominal, dtype=np.float64)[None]
