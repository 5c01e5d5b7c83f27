"""Figures of a landmark network on pictures that no training has: box, crop, network and pose of each picture."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import quaternion
from rpojax.training.detector.average_precision import Interval, wilson_interval
from rpojax.training.pose.held_back_pictures import LIGHT_KINDS, HeldBackPicture
from rpojax.training.pose.landmark_pose import LandmarkPose, landmark_pose
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, DetectorParams, detect
from rpojax.vision.landmark_network.find_landmarks import IN_SIGHT, FoundLandmarks, find_landmarks
from rpojax.vision.landmark_network.landmark_crop import CROP_PX, crop_place
from rpojax.vision.landmark_network.network import Params
from rpojax.vision.surface.landmarks import Landmarks

BOX_SOURCES = ("detector", "jittered")
"""Boxes of the detector, and true ones with errors."""
RANGES_M = ((1.2, 3.0), (3.0, 8.0), (8.0, 20.0), (3.0, 15.0), (15.0, 30.0))
_PORT_RANGE_M = (1.2, 2.0)
_RIGHT_PX = 3.0
_ENOUGH = 8
"""Landmarks that a pose before the port should have."""
_JITTER = 0.03
"""Errors of the edges of true boxes, 1 sigma, by the longer side."""
_REPLICATES = 1000
_BATCH = 16


@dataclasses.dataclass(frozen=True)
class PictureResult:
    """What came out of one picture; NaN and 0 where there is no box or no pose.

    Attributes:
        range_m: true range
        light: as of the picture
        has_pose: whether there is a pose
        attitude_deg: its error
        translation: its error by the range
        errors_px: (v,) errors of the visible landmarks, in pixels of the camera
        squares: (v,) squares of these errors over their covariances
        used: landmarks of the pose
        sight: (k,) whether the visibility of each landmark is told rightly
        right: how many landmarks are rightly called visible, and within 3 px of the crop of where they are
        before_port: as of the picture
    """

    range_m: float
    light: str
    has_pose: bool
    attitude_deg: float
    translation: float
    errors_px: np.ndarray
    squares: np.ndarray
    used: int
    sight: np.ndarray
    right: int
    before_port: bool


def found_boxes(detector: DetectorParams, pictures: Sequence[HeldBackPicture]) -> list[np.ndarray | None]:
    """The best box of a detector in each picture, None where it finds none."""
    boxes: list[np.ndarray | None] = []
    run = jax.jit(lambda images: detect(detector, images, 2))
    codes = np.stack([picture.codes for picture in pictures])
    for low in range(0, len(codes), _BATCH):
        part = codes[low : low + _BATCH]
        padded = np.concatenate([part, np.repeat(part[-1:], _BATCH - len(part), axis=0)]).astype(np.float32) / 255.0
        found = jax.device_get(run(jnp.asarray(padded)))
        for index in range(len(part)):
            picture, box = pictures[low + index], np.asarray(found.box_px)[index, 0]
            inside = np.clip(box, np.tile(picture.frame[:2], 2), np.tile(picture.frame[2:], 2))
            boxes.append(inside if found.score[index, 0] >= SCORE_THRESHOLD else None)
    return boxes


def jittered_boxes(pictures: Sequence[HeldBackPicture], seed: int) -> list[np.ndarray | None]:
    """The true box of each picture with errors, within the frame."""
    rng = np.random.default_rng([seed, 3])
    return [
        np.clip(
            picture.box + _JITTER * (picture.box[2:] - picture.box[:2]).max() * rng.normal(size=4),
            np.tile(picture.frame[:2], 2),
            np.tile(picture.frame[2:], 2),
        )
        for picture in pictures
    ]


def results(
    params: Params, landmarks: Landmarks, pictures: Sequence[HeldBackPicture], boxes: Sequence[np.ndarray | None]
) -> list[PictureResult]:
    """What comes out of each picture with its box."""
    positions = jnp.asarray(landmarks.positions)

    def run(codes: jax.Array, box: jax.Array, frame: jax.Array, focal: jax.Array, center: jax.Array) -> Any:
        found = find_landmarks(params, codes.astype(jnp.float32) / 255.0, box, frame)
        return found, landmark_pose(positions, found, focal, center)

    compiled = jax.jit(run)
    out = []
    for picture, box in zip(pictures, boxes, strict=True):
        if box is None:
            out.append(_without_box(picture))
            continue
        given = (box.astype(np.float32), picture.frame.astype(np.float32), picture.focal_px, picture.center_px)
        found, pose = jax.device_get(compiled(picture.codes, *(jnp.asarray(each) for each in given)))
        out.append(_result(picture, found, pose, float(crop_place(jnp.asarray(box)).side) / CROP_PX))
    return out


def _without_box(picture: HeldBackPicture) -> PictureResult:
    nothing = np.zeros(0)
    return PictureResult(
        picture.range_m, picture.light, False, np.nan, np.nan, nothing, nothing, 0, nothing, 0, picture.before_port
    )


def _result(picture: HeldBackPicture, found: FoundLandmarks, pose: LandmarkPose, crop_px: float) -> PictureResult:
    """Result of a picture; `crop_px` is the side of a pixel of its crop in pixels of the picture."""
    miss = np.asarray(found.places) - picture.places
    squares = np.einsum("ki,ki->k", miss, np.linalg.solve(np.asarray(found.covariance), miss[..., None])[..., 0])
    shown, called = picture.visible, np.asarray(found.visible_probability) > IN_SIGHT
    exists = bool(pose.exists)
    turn = np.asarray(quaternion.to_matrix(jnp.asarray(pose.q_KT))) @ picture.rotation.T
    angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0)))
    return PictureResult(
        range_m=picture.range_m,
        light=picture.light,
        has_pose=exists,
        attitude_deg=float(angle) if exists else np.nan,
        translation=float(np.linalg.norm(pose.r_TK_K - picture.position) / picture.range_m) if exists else np.nan,
        errors_px=np.linalg.norm(miss, axis=1)[shown] * picture.binning,
        squares=squares[shown],
        used=int(np.sum(pose.used)) if exists else 0,
        sight=called == shown,
        right=int((called & shown & (np.linalg.norm(miss, axis=1) < _RIGHT_PX * crop_px)).sum()),
        before_port=picture.before_port,
    )


def summary(found: Sequence[PictureResult]) -> dict[str, Any]:
    """Figures of results of one range and one light, with intervals of 95 %."""
    if not found:
        return {"pictures": 0}
    attitude, translation = (
        np.array([getattr(each, name) for each in found]) for name in ("attitude_deg", "translation")
    )
    has_pose = np.array([each.has_pose for each in found])
    without = int((~has_pose).sum())
    # A picture is drawn with all its landmarks, whose errors are not independent.
    errors, squares = [each.errors_px for each in found], [each.squares for each in found]
    sight = [each.sight for each in found if len(each.sight)]
    return {
        "pictures": len(found),
        "without_pose": round(without / len(found), 4),
        "without_pose_95": wilson_interval(without, len(found)),
        **_figures("attitude_deg", attitude[has_pose], (0.5, 0.95)),
        **_figures("translation_percent", 100.0 * translation[has_pose], (0.5, 0.95)),
        "attitude_beyond_10_deg": round(float((attitude[has_pose] > 10.0).mean()), 4) if has_pose.any() else None,
        "landmarks_used_median": float(np.median([each.used for each in found])),
        "landmark_error_px_median": _of_landmarks(errors, np.median),
        "landmark_error_px_median_95": _landmark_interval(errors, np.median),
        "landmark_nees_over_2_median": _of_landmarks(squares, lambda values: np.median(values) / (2.0 * np.log(2.0))),
        "landmark_nees_over_2_mean": _of_landmarks(squares, lambda values: values.mean() / 2.0),
        "landmark_beyond_3_sigma": _of_landmarks(squares, lambda values: (values > 9.0).mean()),
        "landmarks_right_median": float(np.median([each.right for each in found])),
        "eight_landmarks_right": round(float(np.mean([each.right >= _ENOUGH for each in found])), 4),
        "visibility_right": round(float(np.concatenate(sight).mean()), 4) if sight else None,
    }


def _figures(name: str, values: np.ndarray, quantiles: tuple[float, ...]) -> dict[str, Any]:
    """Quantiles of values with their intervals."""
    out: dict[str, Any] = {}
    for quantile in quantiles:
        label = f"{name}_{'median' if quantile == 0.5 else f'p{round(100 * quantile)}'}"
        out[label] = round(float(np.quantile(values, quantile)), 4) if len(values) else None
        out[f"{label}_95"] = _interval(values, lambda drawn, q=quantile: np.quantile(drawn, q, axis=1))
    return out


def _interval(values: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray]) -> Interval | None:
    """Percentile interval of the bootstrap, of 10 values at least."""
    if len(values) < 10:
        return None
    drawn = values[np.random.default_rng(0).integers(0, len(values), (_REPLICATES, len(values)))]
    low, high = np.quantile(statistic(drawn), [0.025, 0.975])
    return round(float(low), 4), round(float(high), 4)


def _of_landmarks(parts: Sequence[np.ndarray], statistic: Callable[[np.ndarray], Any]) -> float | None:
    """A statistic of the landmarks of all pictures."""
    values = np.concatenate(parts)
    return round(float(statistic(values)), 4) if len(values) else None


def _landmark_interval(parts: Sequence[np.ndarray], statistic: Callable[[np.ndarray], Any]) -> Interval | None:
    """Its interval by a bootstrap over pictures."""
    if len(parts) < 10:
        return None
    rng = np.random.default_rng(0)
    drawn = [_of_landmarks([parts[i] for i in rng.integers(0, len(parts), len(parts))], statistic) for _ in range(200)]
    low, high = np.quantile([each for each in drawn if each is not None], [0.025, 0.975])
    return round(float(low), 4), round(float(high), 4)


def table(found: Sequence[PictureResult]) -> list[dict[str, Any]]:
    """Figures by range and light, and of near views of the docking port."""
    rows = []
    for low, high in RANGES_M:
        inside = [each for each in found if low <= each.range_m < high]
        for light in ("all", *LIGHT_KINDS):
            chosen = [each for each in inside if light in ("all", each.light)]
            if chosen:
                rows.append({"range_m": [low, high], "light": light, **summary(chosen)})
    low, high = _PORT_RANGE_M
    if near := [each for each in found if each.before_port and low <= each.range_m < high]:
        rows.append({"range_m": [low, high], "light": "at port", **summary(near)})
    return rows
