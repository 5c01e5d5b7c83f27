"""Results in the types of JSON."""

from typing import Any

import numpy as np


def to_json_types(value: Any) -> Any:
    """`value` in the types of JSON, with None in place of a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): to_json_types(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json_types(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return to_json_types(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, str | int | bool | None) else str(value)
