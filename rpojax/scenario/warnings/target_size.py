"""Size of the target's hull: its mean, which filters should believe, boxes too small to see, pictures of another."""

import contextlib
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained.coverage_surface import SURFACES, is_surface_used, surface_triangles
from rpojax.scenario.trained.packaged_hull import is_packaged
from rpojax.scenario.trained.trained_files import PACKAGED, file_path
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.target_field import bounds

_ATTITUDES = 512
_MOST_TOO_SMALL = 0.2
"""Share of attitudes whose box may be too small to be detected."""
_MOST_TOO_LARGE = 0.2
"""Share of attitudes in which the frame may cut the target: as that of boxes that are too small."""
_MOST_SPREAD = 0.25
"""Spread of the log of the size over attitudes. A choice between 0.164, with which 61 of 64 runs are completed, and
0.386 (30 m of panels at a bus of 2 m), with which 10 of 16 are, in a low orbit (experiments/own_mission)."""
_LEAST_SIDE_M = 1e-9
_LEAST_SEEN_PX = 1.0
"""Least side of a box of cameras without `minimum_size_px` [px]."""


def hull_sides(hull_m: list[list[float]]) -> np.ndarray:
    """(512, 2) width and height [m] of a hull seen from afar in attitudes all round, in no order of the two."""
    rng = np.random.default_rng(0)
    first = rng.normal(size=(_ATTITUDES, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(first, rng.normal(size=(_ATTITUDES, 3)))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    places = np.einsum("kad,hd->kah", np.stack([first, second], axis=1), np.array(hull_m))
    return places.max(axis=2) - places.min(axis=2)


def mean_size(hull_m: list[list[float]]) -> float:
    """Geometric mean [m] over all attitudes of the root of width times height."""
    return float(np.exp(np.log(np.maximum(hull_sides(hull_m), _LEAST_SIDE_M)).mean()))


def size_spread(hull_m: list[list[float]]) -> float:
    """Standard deviation over all attitudes of the log of the root of width times height."""
    return float(np.log(np.maximum(hull_sides(hull_m), _LEAST_SIDE_M)).mean(axis=1).std())


def shape_warnings(file: ScenarioFile) -> list[str]:
    """A target whose size in the picture changes too much with its attitude to tell the range."""
    spread = size_spread(file.target.hull_m)
    if spread <= _MOST_SPREAD:
        return []
    return [
        f"target.hull_m: the log of the size of the outline varies by {spread:.3g} over attitudes (1 sigma), expected "
        f"at most {_MOST_SPREAD:g}, or filters that take the range from it become too sure of themselves"
    ]


def largest_side_log(hull_m: list[list[float]]) -> tuple[float, float]:
    """Log of the larger side over the root of width times height: mean and standard deviation over all attitudes."""
    logs = np.log(np.maximum(hull_sides(hull_m), _LEAST_SIDE_M))
    larger = logs.max(axis=1) - logs.mean(axis=1)
    return float(larger.mean()), float(larger.std())


def packaged_picture_warnings(file: ScenarioFile) -> list[str]:
    """Pictures and surface of the packaged target for a hull that is nearly of its size."""
    if is_packaged(file.target.hull_m):
        return []
    used = [
        key
        for key, is_used in (
            ("imaging.field", file.camera.model == "rendered" and file.imaging.field == PACKAGED),
            ("coverage.surface", is_surface_used(file.model_dump()) and file.coverage.surface == PACKAGED),
        )
        if is_used
    ]
    return [f"{key}: of the packaged target, whose hull differs a little from target.hull_m" for key in used]


def other_target_warnings(file: ScenarioFile) -> list[str]:
    """A radiance field or a mesh of one's own whose box is not that of the hull: of another target, or in another unit.

    A file that cannot be used gives no line: it is refused where it is needed.
    """
    tables, found = file.model_dump(), []
    if file.camera.model == "rendered" and file.imaging.field != PACKAGED:
        with contextlib.suppress(RpojaxError):
            found.append(("imaging.field", *_field_ends(tables)))
    if is_surface_used(tables) and file.coverage.surface not in SURFACES:
        with contextlib.suppress(RpojaxError):
            corners = surface_triangles(tables).reshape(-1, 3)
            found.append(("coverage.surface", corners.min(axis=0), corners.max(axis=0)))
    hull = np.array(file.target.hull_m)
    sides, room = np.ptp(hull, axis=0), _SAME_SHARE * float(np.ptp(hull, axis=0).max())
    return [
        f"{key}: found a target of {_times(high - low)} m, expected that of target.hull_m, {_times(sides)} m"
        for key, low, high in found
        if max(np.abs(low - hull.min(axis=0)).max(), np.abs(high - hull.max(axis=0)).max()) > room
    ]


def _field_ends(tables: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    low, high = bounds(load_field(file_path(tables, "field"))[0])
    return np.asarray(low), np.asarray(high)


def _times(sides: np.ndarray) -> str:
    return " x ".join(f"{side:.3g}" for side in sides)


_SAME_SHARE = 0.2
"""Largest difference of two boxes' ends over the longest side of the hull; that of a field has a margin around it."""


def small_box_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Places from which the box of the target is too small in a large share of attitudes."""
    sides = hull_sides(file.target.hull_m).max(axis=1) * reach.low("target.scale")
    geometric = file.camera.model == "geometric"
    least = reach.high("camera.minimum_size_px") if geometric else _LEAST_SEEN_PX
    limit = "camera.minimum_size_px" if geometric else "a pixel"
    found = []
    for key, place in (("initial.relative_position_m", "start"), ("formation.desired_position_m", "station")):
        distance = max(reach.norms(key)[1], 1e-3)
        half_angle = np.radians(0.5 * reach.high(_field_of_view_key(file, distance)))
        focal_px = 0.5 * file.camera.width_px / np.tan(half_angle)
        boxes = focal_px * sides / distance
        share = float(np.mean(boxes <= least))
        if share > _MOST_TOO_SMALL:
            seen = "is never seen" if share == 1.0 else f"is not seen in {100.0 * share:.0f} % of attitudes"
            found.append(
                f"{key}: the target {seen} at the {place}, {distance:.4g} m away: the longer side of its box is "
                f"{np.median(boxes):.3g} px in the median, expected above {limit} = {least:.3g} px"
            )
        if (whole := _beyond_frame(file, reach, reach.norms(key)[0])) > _MOST_TOO_LARGE:
            found.append(
                f"{key}: the target does not fit into the frame in {100.0 * whole:.0f} % of attitudes at the {place}, "
                f"{reach.norms(key)[0]:.4g} m away, expected at most {100.0 * _MOST_TOO_LARGE:.0f} %: of a box that "
                "the frame cuts only the bearing is used, and roughly"
            )
    return found


def _beyond_frame(file: ScenarioFile, reach: DispersedReach, distance_m: float) -> float:
    """Share of attitudes in which the target is larger than the frame from that distance."""
    sides = hull_sides(file.target.hull_m).max(axis=1) * reach.high("target.scale")
    half_frame = least_half_frame(file, reach, _field_of_view_key(file, distance_m))
    return float(np.mean(sides > 2.0 * half_frame * max(distance_m, 1e-3)))


def _field_of_view_key(file: ScenarioFile, distance_m: float) -> str:
    """Key of the lens through which the camera looks from a distance [m]."""
    is_wide = file.wide_lens is not None and distance_m < file.wide_lens.switch_range_m
    return "wide_lens.field_of_view_deg" if is_wide else "camera.field_of_view_deg"


def least_half_frame(file: ScenarioFile, reach: DispersedReach, key: str = "camera.field_of_view_deg") -> float:
    """Tangent of half the angle that the camera sees along the shorter side of its frame, by the key of its lens."""
    tangent = float(np.tan(np.radians(0.5 * reach.low(key))))
    return tangent * min(1.0, file.camera.height_px / file.camera.width_px)
