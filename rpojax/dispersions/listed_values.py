"""Values that a choice, a table or a grid lists: numbers, vectors, or kinds of fault by name."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.physics.plant_options import is_fault_kind


def check_listed_values(where: str, key: str, values: list[Any], shape: tuple[int, ...]) -> None:
    """Refuses values of another shape than the key's, and numbers where names are needed or the reverse.

    Raises:
        ScenarioError: naming what was found and what was expected.
    """
    named = any(isinstance(value, str) for value in values)
    if named != is_fault_kind(key):
        raise ScenarioError(where, values[:5], "kinds of fault" if is_fault_kind(key) else "numbers")
    odd = [value for value in values if np.shape(value) != shape]
    if odd:
        raise ScenarioError(where, odd[0], f"values of shape {shape}")


def listed_numbers(values: Sequence[Any]) -> np.ndarray:
    """Listed values as numbers (n, ...), a kind of fault as its code."""
    from rpojax.physics import equipment_faults

    return np.array([equipment_faults.kind_code(value) for value in values], dtype=np.float64)


def listed_ends(values: Sequence[Any], nominal: np.ndarray) -> np.ndarray:
    """Least and greatest of listed numbers, by component (2, ...); the nominal value for names, which have no order."""
    if isinstance(values[0], str):
        return np.stack([nominal, nominal])
    numbers = np.array(values, dtype=np.float64)
    return np.stack([numbers.min(axis=0), numbers.max(axis=0)])
