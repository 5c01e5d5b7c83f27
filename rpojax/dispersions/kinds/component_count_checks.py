"""Checks of settings that several kinds of dispersion share."""

from typing import Any

import numpy as np

from rpojax.errors import ScenarioError


def check_one_or_each(where: str, setting: Any, shape: tuple[int, ...]) -> None:
    """Refuses a setting that is neither one number nor one for each component of a value of the shape."""
    if np.ndim(setting) and np.shape(setting) != shape:
        raise ScenarioError(where, setting, f"one number, or numbers of shape {shape}")


def check_component_count(where: str, kind: str, nominal: np.ndarray, count: int) -> None:
    """Refuses a kind for a key whose value is not a vector of `count` components."""
    if nominal.shape != (count,):
        raise ScenarioError(f"{where}.kind", kind, f"a key with {count} components")
