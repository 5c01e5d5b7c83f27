"""Reference trajectories in npz files: keys and shapes, reading and validation."""

import json
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Numbers = np.ndarray

# A letter is a size that must be equal everywhere: t samples, c commands, w wheels, h thrusters, b burns, z zonals.
_SHAPES = {
    "t": "t",
    "r": "t 3",
    "v": "t 3",
    "q": "t 4",
    "sigma_BN": "t 3",
    "omega": "t 3",
    "Omega": "t w",
    "illumination": "t",
    "r_target": "t 3",
    "v_target": "t 3",
    "r_chaser": "t 3",
    "v_chaser": "t 3",
    "rho": "t 3",
    "torque_gg": "t 3",
    "r0": "3",
    "v0": "3",
    "q0": "4",
    "sigma0": "3",
    "omega0": "3",
    "r0_target": "3",
    "v0_target": "3",
    "r0_chaser": "3",
    "v0_chaser": "3",
    "J": "z",
    "I": "3 3",
    "gs": "w 3",
    "Omega0": "w",
    "t_cmd": "c",
    "u_cmd": "c w",
    "thr_loc": "h 3",
    "thr_dir": "h 3",
    "burns": "b 3",
    "r_sun": "3",
    **dict.fromkeys(("mu", "Re", "m", "dt_ctrl", "K", "P"), ""),
    **dict.fromkeys(("Cd", "A", "H", "rho0", "Cr", "AU", "c", "flux", "R_sun", "Re_eclipse"), ""),
}
_SCALAR_OR_PER_ITEM = ("Js", "F_max", "u_max")
"""Keys with one number for all, or one for each wheel or thruster."""

_POSITIVE = ("mu", "Re", "m", "H", "AU", "c", "R_sun", "Re_eclipse", "dt_ctrl", "Js")

_REQUIRED_GROUPS = (
    ("burns", "F_max", "thr_loc", "thr_dir"),
    ("t_cmd", "u_cmd"),
    ("gs", "Js", "Omega0"),
    ("Re_eclipse", "R_sun"),
)
"""Keys that are required together."""

_REQUIRED_KEY = {
    **dict.fromkeys(("u_cmd", "u_max", "Omega", "K"), "gs"),
    **dict.fromkeys(("omega", "torque_gg"), "q"),
    **dict.fromkeys(("v", "illumination"), "r"),
    **dict.fromkeys(("v_target", "r_chaser", "v_chaser", "rho"), "r_target"),
    "r_target": "r_chaser",
}
"""Key -> key that it requires."""
_READ_ERRORS = (OSError, EOFError, ValueError, KeyError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)
"""Errors of numpy and zipfile for damaged, encrypted or unsupported archives."""


class FormatError(ValueError):
    """A file is not a valid reference; the message is one line."""


@dataclass(frozen=True)
class Reference:
    """Reference trajectory.

    Attributes:
        case: name
        meta: description
        arrays: key -> array
        unknown: key -> array of the keys that the format does not define
    """

    case: str
    meta: dict[str, Any]
    arrays: dict[str, Numbers]
    unknown: dict[str, Numbers]

    def __contains__(self, key: str) -> bool:
        return key in self.arrays

    def __getitem__(self, key: str) -> Numbers:
        if key not in self.arrays:
            raise FormatError(f"{self.case}: key {key!r} is missing, which its other keys need")
        return self.arrays[key]

    def number(self, key: str, default: float | None = None) -> float:
        """Scalar of the file, or the default if there is one and the file lacks the key."""
        return float(self[key]) if default is None or key in self else default

    def initial(self, key: str, history: str) -> Numbers:
        """Initial value: its own key, or the first sample of a history that starts at time 0."""
        if key not in self and history in self and self["t"][0] == 0.0:
            return self[history][0]
        return self[key]


def read_reference(path: Path) -> Reference:
    """Reads and validates a reference.

    Raises:
        FormatError: the file is not a valid reference.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise FormatError(f"{path}: found a bare array, expected an npz file of named arrays")
            arrays = {key: file[key] for key in file.files}
    except _READ_ERRORS as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: not a readable npz file ({' '.join(str(error).split())})") from error
    try:
        return validate(path.stem, arrays)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None


def validate(stem: str, arrays: dict[str, Any]) -> Reference:
    """Reference from the arrays of a file.

    Raises:
        FormatError: the arrays are not a valid reference.
    """
    arrays = dict(arrays)
    meta = _meta(arrays.pop("meta_json", np.array("{}")))
    known = {key: _numbers(key, value) for key, value in arrays.items() if key in _SHAPES or key in _SCALAR_OR_PER_ITEM}
    known = {key: value for key, value in known.items() if not _is_other(key, value)}
    if "t" not in known:
        raise FormatError("key 't' is missing: no reference trajectory")
    sizes: dict[str, int] = {}
    for key, value in known.items():
        _check_shape(key, value, sizes)
    if "q" not in known and "sigma_BN" in known:
        known["q"] = quaternion_from_mrp(known["sigma_BN"])
    if "q0" not in known and "sigma0" in known:
        known["q0"] = quaternion_from_mrp(known["sigma0"])
    _check_values(known)
    case = " ".join(str(meta.get("case", stem)).split())
    return Reference(
        case=case, meta=meta, arrays=known, unknown={key: arrays[key] for key in arrays.keys() - known.keys()}
    )


def _meta(value: Numbers) -> dict[str, Any]:
    try:
        meta = json.loads(str(value))
    except (json.JSONDecodeError, RecursionError) as error:
        raise FormatError(f"key 'meta_json' is not JSON ({error})") from error
    if not isinstance(meta, dict):
        raise FormatError("key 'meta_json': expected a JSON object")
    return meta


def _numbers(key: str, value: Numbers) -> Numbers:
    if value.dtype.kind not in "fiu":
        raise FormatError(f"key {key!r}: found type {value.dtype}, expected numbers")
    if not np.all(np.isfinite(value)):
        raise FormatError(f"key {key!r}: not finite everywhere")
    return value.astype(np.float64)


def _is_other(key: str, value: Numbers) -> bool:
    """Whether a key has another meaning in this file: `rho` is a relative position or a density."""
    return (_SHAPES.get(key) == "" and value.size > 1) or (key == "rho" and value.ndim == 1)


def _check_shape(key: str, value: Numbers, sizes: dict[str, int]) -> None:
    if key in _SCALAR_OR_PER_ITEM:
        return
    expected = _SHAPES[key].split()
    wanted = [int(name) if name.isdigit() else sizes.get(name, -1) for name in expected]
    single = not expected and value.size == 1
    same = value.ndim == len(expected) and all(map(_agrees, wanted, value.shape))
    if not (same or single):
        raise FormatError(f"key {key!r}: found shape {value.shape}, expected ({', '.join(expected)})")
    sizes.update({name: size for name, size in zip(expected, value.shape, strict=False) if not name.isdigit()})


def _agrees(wanted: int, found: int) -> bool:
    return wanted in (-1, found)


def _check_values(arrays: dict[str, Numbers]) -> None:
    for key in ("t", "t_cmd"):
        if key in arrays and (arrays[key].size == 0 or np.any(np.diff(arrays[key]) <= 0.0) or arrays[key][0] < 0.0):
            raise FormatError(f"key {key!r}: expected times that increase from 0 or later")
    if arrays["t"][-1] <= 0.0:
        raise FormatError("key 't': expected a sample after 0")
    for key in _POSITIVE:
        if key in arrays and np.any(arrays[key] <= 0.0):
            raise FormatError(f"key {key!r}: found {np.min(arrays[key]):g}, expected more than 0")
    for key in ("q", "q0"):
        if key in arrays and np.any(np.abs(np.linalg.norm(arrays[key], axis=-1) - 1.0) > 1e-6):
            raise FormatError(f"key {key!r}: expected unit quaternions")
    if not {"r", "q", "r_target"} & arrays.keys():
        raise FormatError("nothing to compare: none of the keys 'r', 'q', 'r_target'")
    if "I" in arrays:
        _check_inertia(arrays["I"])
    if "thr_dir" in arrays and np.any(np.linalg.norm(arrays["thr_dir"], axis=1) == 0.0):
        raise FormatError("key 'thr_dir': found a direction of length 0, expected none")
    _check_groups(arrays)
    if "illumination" in arrays and "R_sun" not in arrays:
        raise FormatError("key 'R_sun' is missing: found 'illumination', expected 'Re_eclipse' and 'R_sun' with it")
    if "burns" in arrays:
        _check_burns(arrays)


def _check_inertia(inertia: Numbers) -> None:
    """Checks that a tensor is a possible inertia, within 1e-9 of its size."""
    slack = 1e-9 * float(np.max(np.abs(inertia)))
    if np.any(np.abs(inertia - inertia.T) > slack):
        raise FormatError("key 'I': found a tensor that is not symmetric, expected one of a body")
    small, middle, large = np.linalg.eigvalsh(inertia)
    if not small > 0.0:
        raise FormatError(f"key 'I': found a principal moment of {small:g}, expected more than 0")
    if large > small + middle + slack:
        raise FormatError(
            f"key 'I': found moments {small:g}, {middle:g}, {large:g}, expected the sum of two above the third"
        )


def _check_groups(arrays: dict[str, Numbers]) -> None:
    for group in _REQUIRED_GROUPS:
        found, missing = [key for key in group if key in arrays], [key for key in group if key not in arrays]
        if found and missing:
            raise FormatError(f"key {missing[0]!r} is missing: found {_list(found)}, expected {_list(group)} together")
    for key, needed in _REQUIRED_KEY.items():
        if key in arrays and needed not in arrays:
            raise FormatError(f"key {needed!r} is missing: found {key!r}, expected {needed!r} with it")


def _list(keys: Iterable[str]) -> str:
    return ", ".join(map(repr, keys))


def _check_burns(arrays: dict[str, Numbers]) -> None:
    count = arrays["thr_loc"].shape[0]
    index = arrays["burns"][:, 0]
    if np.any(index != np.round(index)) or np.any(index < 0) or np.any(index >= count):
        raise FormatError(f"key 'burns': found a thruster that is not one of the {count} of 'thr_loc'")
    if np.any(arrays["burns"][:, 1:] < 0.0):
        raise FormatError("key 'burns': expected start and on-time of at least 0")


def quaternion_from_mrp(sigma: Numbers) -> Numbers:
    """Scalar-first Euler parameters (..., 4) of modified Rodrigues parameters (..., 3)."""
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    return np.concatenate([1.0 - square, 2.0 * sigma], axis=-1) / (1.0 + square)
