"""Size of the target's hull: its mean, which filters should believe, boxes too small to see, pictures of another."""

import numpy as np

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained.packaged_hull import is_packaged
from rpojax.scenario.trained.trained_files import PACKAGED
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

_ATTITUDES = 512
_MOST_TOO_SMALL = 0.2
"""Share of attitudes whose box may be too small to be detected."""
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


def packaged_picture_warnings(file: ScenarioFile) -> list[str]:
    """Pictures and surface of the packaged target for a hull that is nearly of its size."""
    if is_packaged(file.target.hull_m):
        return []
    used = [
        key
        for key, is_used in (
            ("imaging.field", file.camera.model == "rendered" and file.imaging.field == PACKAGED),
            ("coverage.surface", file.coverage.enabled and file.coverage.surface == PACKAGED),
        )
        if is_used
    ]
    return [f"{key}: of the packaged target, whose hull differs a little from target.hull_m" for key in used]


def small_box_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Places from which the box of the target is too small in a large share of attitudes."""
    sides = hull_sides(file.target.hull_m).max(axis=1) * reach.low("target.scale")
    half_angle = np.radians(0.5 * reach.high("camera.field_of_view_deg"))
    focal_px = 0.5 * file.camera.width_px / np.tan(half_angle)
    geometric = file.camera.model == "geometric"
    least = reach.high("camera.minimum_size_px") if geometric else _LEAST_SEEN_PX
    limit = "camera.minimum_size_px" if geometric else "a pixel"
    found = []
    for key, place in (("initial.relative_position_m", "start"), ("formation.desired_position_m", "station")):
        distance = max(reach.norms(key)[1], 1e-3)
        boxes = focal_px * sides / distance
        share = float(np.mean(boxes <= least))
        if share > _MOST_TOO_SMALL:
            seen = "is never seen" if share == 1.0 else f"is not seen in {100.0 * share:.0f} % of attitudes"
            found.append(
                f"{key}: the target {seen} at the {place}, {distance:.4g} m away: the longer side of its box is "
                f"{np.median(boxes):.3g} px in the median, expected above {limit} = {least:.3g} px"
            )
    return found
