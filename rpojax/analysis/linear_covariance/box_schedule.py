"""Frames of the nominal run that may have a box: misses and look-aways are spaced evenly at their expected rate."""

import numpy as np

from rpojax.analysis.linear_covariance.burn_decision import BurnDecision
from rpojax.scenario.sections import CameraSection
from rpojax.scenario.static_settings import Scenario


class BoxSchedule:
    """Which frames of successive burn periods may have a box.

    A frame is left out whenever the expected number of misses has grown by one, and the look-away of a burn whenever
    the expected number of burns that the nominal run does not make has.
    """

    def __init__(self, scenario: Scenario, camera: CameraSection) -> None:
        self._scenario = scenario
        self._miss_rate = 1.0 - (1.0 - camera.miss_probability) * (1.0 - camera.outlier_probability)
        self._expected_misses, self._expected_burns = 0.0, 0.0

    def next_period(self, last: BurnDecision | None) -> np.ndarray:
        """Flags (ticks,) of the next period's frames, after its predecessor's burn decision."""
        allowed = np.ones(self._scenario.formation_ticks, dtype=bool)
        for tick in range(len(allowed)):
            self._expected_misses += self._miss_rate
            allowed[tick] = self._expected_misses < 1.0
            self._expected_misses -= 0.0 if allowed[tick] else 1.0
        if last is not None and not np.any(last.nominal_burn):
            self._expected_burns += last.probability
            if self._expected_burns >= 1.0:
                self._expected_burns -= 1.0
                times = np.arange(len(allowed)) * self._scenario.tick_s
                allowed &= (times < last.look_away[0]) | (times >= last.look_away[1])
        return allowed
