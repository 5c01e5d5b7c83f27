"""Arrays inside of a page: base64 of little-endian numbers, exact as float32 or bytes, or rounded to 16 bits."""

import base64
from typing import Any, Final

import numpy as np

LARGEST_CODE: Final = 32767
"""Codes run from minus this to this; the one below stands for NaN."""
_UNDEFINED: Final = -LARGEST_CODE - 1

Packed = dict[str, Any]
"""`kind` of numbers, `size` of a row, `data`, and of rounded numbers `low` and `step` of each component."""


def pack_floats(values: np.ndarray) -> Packed:
    """Rows (n,) or (n, k) as float32."""
    return _packed("float32", np.asarray(values, dtype="<f4"))


def pack_bytes(values: np.ndarray) -> Packed:
    """Rows (n,) of whole numbers from 0 to 255.

    Raises:
        ValueError: a number does not fit.
    """
    whole = np.asarray(values)
    if whole.size and not 0 <= whole.min() <= whole.max() <= 255:
        raise ValueError(f"found {whole.min()} to {whole.max()}, expected 0 to 255")
    return _packed("uint8", whole.astype(np.uint8))


def pack_rounded(values: np.ndarray) -> Packed:
    """Rows (n, k), each component rounded to one of 65535 equal steps of its range; off by half a step at most."""
    rows = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(rows)
    low = np.min(np.where(finite, rows, np.inf), axis=0, initial=np.inf)
    high = np.max(np.where(finite, rows, -np.inf), axis=0, initial=-np.inf)
    low, high = np.where(low <= high, low, 0.0), np.where(low <= high, high, 0.0)
    step = np.where(high > low, (high - low) / (2 * LARGEST_CODE), 1.0)
    places = np.round((np.where(finite, rows, low) - low) / step).astype(np.int64) - LARGEST_CODE
    codes = np.where(finite, places, _UNDEFINED).astype("<i2")
    return {**_packed("int16", codes), "low": low.tolist(), "step": step.tolist()}


def unpack(packed: Packed) -> np.ndarray:
    """Rows (n,) or (n, k) of a packed array, as the page reads them."""
    numbers = np.frombuffer(base64.b64decode(packed["data"]), dtype=np.dtype(packed["kind"]).newbyteorder("<"))
    rows = numbers if packed["size"] == 1 and "low" not in packed else numbers.reshape(-1, packed["size"])
    if "low" not in packed:
        return rows
    values = np.array(packed["low"]) + np.array(packed["step"]) * (rows.astype(np.float64) + LARGEST_CODE)
    return np.where(rows == _UNDEFINED, np.nan, values)


def _packed(kind: str, rows: np.ndarray) -> Packed:
    size = 1 if rows.ndim == 1 else rows.shape[1]
    return {"kind": kind, "size": size, "data": base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode()}
