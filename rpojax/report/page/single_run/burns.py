"""Burns of one run, from the velocity change applied so far."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rpojax.report.number_format import format_number
from rpojax.report.page.single_run.run_series import formation_error

_LEAST_M_S: Final = 1e-7
"""Smaller changes in a tick are rounding of the channel."""
_LONGEST_GAP: Final = 2
"""Ticks without thrust that do not end a burn."""


@dataclass(frozen=True)
class Burn:
    """A burn: when it began and ended [s], velocity change [m/s], and range and formation error [m] at its begin."""

    begin_s: float
    end_s: float
    delta_v_m_s: float
    range_m: float
    formation_error_m: float


def find_burns(history: Mapping[str, np.ndarray]) -> list[Burn]:
    """Burns in order of time; none if the history lacks the velocity change or the position."""
    if not {"delta_v_m_s", "rho_H", "rho_desired_H"} <= history.keys():
        return []
    spent = np.nan_to_num(np.asarray(history["delta_v_m_s"], dtype=np.float64), nan=0.0)
    ticks = np.flatnonzero(np.diff(spent) > _LEAST_M_S)
    if not len(ticks):
        return []
    parts = np.split(ticks, np.flatnonzero(np.diff(ticks) > _LONGEST_GAP + 1) + 1)
    error, time = formation_error(history), history["time_s"]
    distance = np.linalg.norm(history["rho_H"], axis=-1)
    return [
        Burn(
            float(time[part[0]]),
            float(time[part[-1] + 1]),
            float(spent[part[-1] + 1] - spent[part[0]]),
            float(distance[part[0]]),
            float(error[part[0]]),
        )
        for part in parts
    ]


def burn_rows(burns: Sequence[Burn]) -> list[list[str]]:
    """Cells of the table: number, begin, duration, velocity change in mm/s, range and formation error at the begin."""
    return [
        [
            str(number),
            format_number(burn.begin_s),
            format_number(burn.end_s - burn.begin_s),
            format_number(1e3 * burn.delta_v_m_s, 3),
            format_number(burn.range_m, 3),
            format_number(burn.formation_error_m, 3),
        ]
        for number, burn in enumerate(burns, start=1)
    ]
