"""Camera that holds the target in the frame where it is nearest and resolves it where it is farthest."""

import math

from rpojax.scenario.own_mission.choices import Choice, Choices, tidy, up_to
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.own_mission.target_outline import Outline

_ROOM, _NEARER = 1.2, 0.9
"""Frame over the target's diameter, where the servicer is nearer than its station by a tenth."""
_FARTHER = 1.1
_LEAST_LENS_DEG, _WIDEST_LENS_DEG = 10.0, 120.0
_WANTED_PX, _LEAST_PX = 16.0, 6.0
"""Size of the target at the start [px]: as in `inspection`, and that below which a range is hardly had."""
_SIDES_PX = (128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096)
_TOLERANCE_PX_S = 5.0
_SEARCH_SHARE = 0.65


def needed_lens_deg(facts: MissionFacts, outline: Outline) -> float:
    """Field of view that holds the target at the last station."""
    return 2.0 * math.degrees(math.atan(_ROOM * 0.5 * outline.diameter_m / (_NEARER * facts.nearest_m)))


def size_at_start_px(facts: MissionFacts, outline: Outline, lens_deg: float, pixels: int) -> float:
    """Mean size of the target in the picture from a tenth farther than the start."""
    frame = 2.0 * math.tan(math.radians(0.5 * lens_deg)) * _FARTHER * facts.first_m
    return pixels * outline.size_m / frame


def lens_choices(facts: MissionFacts, outline: Outline) -> Choices:
    """Keys of the camera, and what search and filter take from it."""
    needed = needed_lens_deg(facts, outline)
    lens = facts.lens_deg or min(max(up_to(needed, 1.0), _LEAST_LENS_DEG), _WIDEST_LENS_DEG)
    pixels = facts.pixels or next(
        (side for side in _SIDES_PX if size_at_start_px(facts, outline, lens, side) >= _WANTED_PX), _SIDES_PX[-1]
    )
    found = size_at_start_px(facts, outline, lens, pixels)
    pixel_deg = math.degrees(2.0 * math.tan(math.radians(0.5 * lens)) / pixels)
    turning = facts.tumble_deg_s * 0.5 * outline.diameter_m / facts.nearest_m
    far = f"{found:.3g} px of {outline.size_m:.3g} m at {_FARTHER * facts.first_m:.3g} m"
    holds = f"holds {outline.diameter_m:.3g} m and a fifth at {_NEARER * facts.nearest_m:.3g} m: {needed:.3g} deg"
    return Choices(
        [
            Choice("camera.width_px", pixels, far),
            Choice("camera.height_px", pixels),
            Choice("camera.field_of_view_deg", lens, holds + (", and at least 10" if needed < lens == 10.0 else "")),
            Choice("camera.outlier_size_max_px", 0.5 * pixels, "half of the frame"),
            Choice(
                "navigation.confirm_tolerance_deg_s",
                tidy(_TOLERANCE_PX_S * pixel_deg + turning),
                f"5 px/s of {pixel_deg:.3g} deg, and the tumble's {turning:.2g} deg/s at {facts.nearest_m:g} m",
            ),
            Choice("pointing.search_pitch_deg", tidy(_SEARCH_SHARE * lens), "0.65 of the field of view"),
        ]
    )


def lens_problems(facts: MissionFacts, outline: Outline, lens_deg: float, pixels: int) -> list[str]:
    """A line for a lens that cannot do what the distances ask: what is there and what is needed."""
    needed, found = needed_lens_deg(facts, outline), size_at_start_px(facts, outline, lens_deg, pixels)
    problems = []
    if needed > lens_deg + 0.5:
        problems.append(
            f"camera.field_of_view_deg: found {lens_deg:.3g}, expected at least {needed:.3g} to hold a target of "
            f"{outline.diameter_m:.3g} m at {facts.nearest_m:g} m"
        )
    if found < _LEAST_PX:
        least = math.ceil(pixels * _LEAST_PX / found)
        problems.append(
            f"camera.width_px: found {pixels}, expected at least {least} for {_LEAST_PX:g} px of a target of "
            f"{outline.size_m:.3g} m at {_FARTHER * facts.first_m:.3g} m (the lens has {lens_deg:.3g} deg)"
        )
    return problems
