"""SPEED, SPEED+ and SHIRT: pictures of the Tango spacecraft with its pose, from which its box is worked out.

Sources: Kisantal et al., Satellite Pose Estimation Challenge, 2020; Park et al., SPEED+: Next-Generation Dataset for
Spacecraft Pose Estimation across Domain Gap, 2022; Park and D'Amico, Adaptive Neural Network-based Unscented Kalman
Filter, 2022 (SHIRT).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.errors import RpojaxError
from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.public_data.labelled_picture import LabelledPicture, reason_in_short
from rpojax.untrusted.file_reading import FileKind, absolute_path, is_regular
from rpojax.untrusted.json_reading import read_json

TANGO_POINTS = np.array(
    [
        [-0.3700, -0.3850, 0.3215],
        [-0.3700, 0.3850, 0.3215],
        [0.3700, 0.3850, 0.3215],
        [0.3700, -0.3850, 0.3215],
        [-0.3700, -0.2640, 0.0],
        [-0.3700, 0.3040, 0.0],
        [0.3700, 0.3040, 0.0],
        [0.3700, -0.2640, 0.0],
        [-0.5427, 0.4877, 0.2535],
        [0.5427, 0.4877, 0.2591],
        [0.3050, -0.5790, 0.2515],
    ]
)
"""Corners of Tango's panel and body, and the tips of its antennas (11, 3) [m].

The data sets have no shape. These are the points of the pose networks of their authors, which were recovered from
pictures as in Park, Sharma and D'Amico, Towards Robust Learning-Based Pose Estimation of Noncooperative Spacecraft,
2019.
"""
_RADIUS_M = float(np.linalg.norm(TANGO_POINTS, axis=1).max())
LABEL_FILES = ("test.json", "validation.json", "train.json")
"""Names of label files, of which the first one that exists counts: those not meant for training come first."""
_POSITION = "r_Vo2To_vbs_true"
_ATTITUDES = ("q_vbs2tango_true", "q_vbs2tango")


@dataclass(frozen=True)
class _Camera:
    """Camera of a data set: matrix (3, 3) [px], distortion as OpenCV has it, and width and height [px]."""

    matrix: np.ndarray
    distortion: np.ndarray
    width: int
    height: int


def list_pictures(folder: Path, labels: Path | None = None) -> list[LabelledPicture]:
    """Pictures of a domain such as `lightbox`, with the box of the spacecraft's projected points.

    Args:
        folder: with `images`, and with `camera.json` in it or in one of two folders above
        labels: label file, by default the first of `LABEL_FILES` in the folder, or that of its trajectory in SHIRT,
            such as `roe1.json` in `roe1`, the folder above

    Raises:
        DatasetError: a file is missing or not as expected.
    """
    # The name of `.` and the folders above it are those of its absolute path.
    place = absolute_path(folder)
    above = place.parent
    if labels is None:
        labels = _find(folder, [*(place / name for name in LABEL_FILES), above / f"{above.name}.json"])
    camera = _read_camera(_find(folder, [each / "camera.json" for each in (place, above, above.parent)]))
    content = _read(labels)
    if not isinstance(content, list) or not content:
        found = "an empty list" if isinstance(content, list) else f"no list but {type(content).__name__}"
        raise DatasetError(f"{labels}: found {found}, expected a list of pictures with their poses")
    return [_picture(folder, labels, camera, number, entry) for number, entry in enumerate(content)]


def _find(folder: Path, places: Sequence[Path]) -> Path:
    found = next(filter(is_regular, places), None)
    if found is None:
        names = ", ".join(dict.fromkeys(place.name for place in places))
        raise DatasetError(
            f"{folder}: found none of {names} in it or above, expected one, and the folder of a domain such as "
            "speedplus/lightbox"
        )
    return found


def _read(path: Path) -> Any:
    try:
        return read_json(path, FileKind.PROGRESS)
    except RpojaxError as error:
        raise DatasetError(f"{path}: cannot be read ({reason_in_short(error)}), expected JSON as in SPEED+") from None


def _read_camera(path: Path) -> _Camera:
    content = _read(path)
    try:
        camera = _Camera(
            np.array(content["cameraMatrix"], dtype=float).reshape(3, 3),
            np.array(content["distCoeffs"], dtype=float).reshape(-1),
            int(content["Nu"]),
            int(content["Nv"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DatasetError(
            f"{path}: found a fault at {reason_in_short(error)}, expected cameraMatrix, distCoeffs (zeros without "
            "distortion), Nu and Nv"
        ) from None
    (fx, skew, _), (low, fy, _), last = camera.matrix.tolist()
    if not (fx > 0.0 and fy > 0.0 and abs(skew) < fx and low == 0.0 and last == [0.0, 0.0, 1.0]):
        found = json.dumps(camera.matrix.tolist())[:120]
        raise DatasetError(f"{path}: found cameraMatrix {found}, expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    if len(camera.distortion) not in (4, 5, 8, 12, 14) or min(camera.width, camera.height) < 1:
        raise DatasetError(f"{path}: found {len(camera.distortion)} coefficients, expected a camera of OpenCV")
    return camera


def _picture(folder: Path, labels: Path, camera: _Camera, number: int, entry: Any) -> LabelledPicture:
    try:
        name = str(entry["filename"])
        attitudes = [np.array(entry[key], dtype=float).reshape(4) for key in _ATTITUDES if key in entry]
        r = np.array(entry[_POSITION], dtype=float).reshape(3)
        q = attitudes[0]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        # SPEED, and SPEED+ before its second version, have a list of test pictures without poses.
        keys = f"filename, {_ATTITUDES[0]} and {_POSITION}, or other labels"
        raise DatasetError(
            f"{labels}: found a fault at picture {number} ({reason_in_short(error)}), expected {keys}"
        ) from None
    if not (r[2] > _RADIUS_M and 0.99 < np.linalg.norm(q) < 1.01):
        raise DatasetError(
            f"{labels}: found {name!r:.80} at {r[2]:g} m with a quaternion of norm {np.linalg.norm(q):g}, expected a "
            "spacecraft in front of the camera and a unit quaternion"
        )
    if any((attitude != q).any() for attitude in attitudes):
        raise DatasetError(f"{labels}: found {name!r:.80} with different {' and '.join(_ATTITUDES)}, expected one")
    box = projected_box(camera.matrix, camera.distortion, q, r)
    return LabelledPicture(
        _image_path(folder, labels, name),
        box[None],
        background=absolute_path(folder).name,
        sides=(camera.width, camera.height),
    )


def _image_path(folder: Path, labels: Path, name: str) -> Path:
    if Path(name).name != name or name in ("", ".."):
        raise DatasetError(f"{labels}: found filename {name!r:.80}, expected a name without folders")
    places = [folder / "images" / name, folder / "images" / labels.stem / name, folder / name]
    found = next(filter(is_regular, places), None)
    if found is None:
        raise DatasetError(f"{places[0]}: found no such file, expected a picture that {labels} names")
    return found


def projected_box(matrix: np.ndarray, distortion: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Box (4,) [px] around Tango's points, the spacecraft at `r` (3,) [m] in the camera's axes.

    `q` (4,), scalar first, is the rotation from the camera's to the spacecraft's axes as the data sets have it.
    """
    turn = Rotation.from_quat(q[[1, 2, 3, 0]]).as_rotvec()
    points, _ = cv2.projectPoints(TANGO_POINTS, turn, r, matrix, distortion)
    points = points.reshape(-1, 2)
    return np.concatenate([points.min(axis=0), points.max(axis=0)])
