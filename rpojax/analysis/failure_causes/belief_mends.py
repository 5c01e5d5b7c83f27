"""What mends a belief that the scenario contradicts: to believe the truth, or to bring the truth to the belief."""

import re
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes.present_values import at_most, change, present_text
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

_TRUTH: Final = re.compile(
    r"(?:the truth is|is up to|is down to|over all attitudes is)(?: up to| down to)? ([0-9.e+-]+)"
)
"""Value of the truth in a warning about a belief."""
_BELIEVED: Final = re.compile(r"the filter believes ([0-9.e+-]+)")
_OF_ONE_KEY: Final = re.compile(r" by ([a-z_]+\.[a-z_.]+)(?:,|$)")
"""The key of the truth, where it is one alone."""
_LASTING: Final = {
    "navigation.burn_magnitude_sigma": ("navigation.burn_scale_sigma", "thruster.force_scale", 1.0),
    "navigation.burn_direction_sigma_deg": (
        "navigation.thrust_direction_sigma_deg",
        "thruster.misalignment_deg",
        0.0,
    ),
}
"""Of beliefs of a random error that a second one, of its lasting part, is added to: that one, and its truth's key with
the value without an error."""
_HARDWARE: Final = {
    "navigation.bearing_bias_sigma_deg": (("camera.misalignment_deg", 0.0), ("star_tracker.misalignment_deg", 0.0)),
    "navigation.burn_magnitude_sigma": (("thruster.magnitude_noise", 0.0), ("thruster.force_scale", 1.0)),
    "navigation.thrust_sigma": (("thruster.magnitude_noise", 0.0), ("thruster.force_scale", 1.0)),
    "navigation.burn_direction_sigma_deg": (("thruster.direction_noise_deg", 0.0), ("thruster.misalignment_deg", 0.0)),
}
"""Keys of the errors that a belief is of where these are several, with the value without an error."""


def belief_mend(file: ScenarioFile, reach: DispersedReach, key: str, words: str) -> str:
    """What mends a belief, by the words of a warning about it: believe the truth, or mend the hardware."""
    truth, believed = (pattern.search(words) for pattern in (_TRUTH, _BELIEVED))
    if truth is None or believed is None:
        return f"a belief that fits ({key})"
    hardware = _hardware(reach, key, words)
    if hardware is None:
        return change(file, key, float(truth[1]))
    of_truth, ideal = hardware
    belief = key
    if key in _LASTING and of_truth == _LASTING[key][1]:
        belief = _LASTING[key][0]
    mended = at_most(file, of_truth, float(believed[1]))
    largest = _largest(reach, of_truth, ideal)
    if float(np.max(np.abs(reach.middle(of_truth) - ideal))) < 0.5 * largest:
        mended = f"{of_truth}: dispersed by up to {largest:.3g}, at most {float(believed[1]):.3g}"
    elif ideal:
        mended = change(file, of_truth, ideal) + f" (to within {float(believed[1]):.3g})"
    told = change(file, belief, float(truth[1]))
    return (
        f"either mend the hardware: {mended}; or believe the error: {told}, which makes the filter consistent and not "
        "the mission accurate"
    )


def believed_text(file: ScenarioFile, key: str, words: str) -> str:
    """The words of a warning, with the keys that a belief is made of where it is of two."""
    if key not in _LASTING:
        return words
    both = f"{key.partition('.')[2]} {present_text(file, key)} and {_LASTING[key][0].partition('.')[2]} "
    both += present_text(file, _LASTING[key][0])
    return _BELIEVED.sub(lambda found: f"{found[0]} ({both})", words, count=1)


def _largest(reach: DispersedReach, key: str, ideal: float) -> float:
    """Largest error of a key between the ends of its dispersion."""
    return float(np.max(np.abs(reach.ends(key) - ideal)))


def _hardware(reach: DispersedReach, key: str, words: str) -> tuple[str, float] | None:
    """Key of the error that contributes most to the truth of a belief, and its value without an error."""
    if key in _HARDWARE:
        return max(_HARDWARE[key], key=lambda each: _largest(reach, *each))
    found = _OF_ONE_KEY.search(words)
    return None if found is None else (found[1], 0.0)
