"""Starts of the free drifts of runs, from recorded channels.

Between two burns a run drifts freely, so that all instants of such a coast share one drift: its end is followed longer,
up to the horizons of its last instant. A drift of its own begins at each instant during a burn and, with the thruster
stuck open, at the end of each burn.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Integers = NDArray[np.integer]

REQUIRED_CHANNELS: Final = ("r_ST_N", "v_ST_N", "mass_kg", "delta_v_m_s", "running")
"""Channels of which the starts are made."""


@dataclass(frozen=True)
class DriftStarts:
    """Drifts of one run in order of time.

    Attributes:
        ticks: (drifts,) at which each begins
        last_ticks: (drifts,) of its last instant
        burn_ticks: (drifts,) last tick before the burn after which the thruster is stuck open; `ticks` if it is not
        is_stuck: (drifts,) whether it is
        r_ST_N: (2, 3, drifts) servicer from target before that burn and at the start [m]
        v_ST_N: (2, 3, drifts) its inertial derivative [m/s]
        mass: (drifts,) of the servicer [kg]
        last_delta_v: (drifts,) applied in the tick before the start [m/s]
        instants: (instants,) ticks
        instant_drifts: (instants,) the drift of each
    """

    ticks: Integers
    last_ticks: Integers
    burn_ticks: Integers
    is_stuck: NDArray[np.bool_]
    r_ST_N: Floats
    v_ST_N: Floats
    mass: Floats
    last_delta_v: Floats
    instants: Integers
    instant_drifts: Integers

    def unsafe_fraction(self, unsafe: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
        """Share of the time between instants that belongs to those of `unsafe` (instants,), half to either side.

        Only the instants of `among` (instants,) count, at least one.
        """
        instants, unsafe = self.instants[among], unsafe[among]
        if len(instants) == 1:
            return float(unsafe[0])
        half_gaps = 0.5 * np.diff(instants)
        weights = np.concatenate([half_gaps, [0.0]]) + np.concatenate([[0.0], half_gaps])
        return float(np.sum(weights * unsafe) / np.sum(weights))


def drift_starts(records: Mapping[str, Floats], spacing_ticks: int, divisions: Collection[int] = ()) -> DriftStarts:
    """Drifts of one run from its channels (ticks, ...), at every `spacing_ticks` and at both ends of each burn.

    Further instants are those ticks of `divisions` at which the run lasts, and a coast begins anew there.
    """
    ticks = max(1, int(np.sum(records["running"])))
    delta_v = records["delta_v_m_s"][:ticks]
    burning = np.diff(delta_v) > 0.0
    # What follows the last tick is not known.
    burning = np.append(burning, burning[-1:].any())
    before = np.concatenate([[False], burning[:-1]])
    ignitions = np.flatnonzero(burning & ~before)
    ends = np.flatnonzero(~burning & before)
    spaced = np.arange(0, ticks, spacing_ticks)
    divided = np.array([tick for tick in divisions if tick < ticks], dtype=int)
    instants = np.union1d(spaced, np.concatenate([ignitions, ends, divided]))
    in_burn = instants[burning[instants] & before[instants]]
    coasts = np.union1d([0], ends) if not burning[0] else np.concatenate([[0], ends])
    coasts = np.union1d(coasts, np.setdiff1d(divided, in_burn))
    begins = np.concatenate([coasts, in_burn, ends]).astype(int)
    is_stuck = np.arange(len(begins)) >= len(coasts) + len(in_burn)
    order = np.argsort(begins, kind="stable")
    begins, is_stuck = begins[order], is_stuck[order]
    own = np.flatnonzero(~is_stuck)
    instant_drifts = own[np.searchsorted(begins[own], instants, side="right") - 1]
    last_ticks = begins.copy()
    np.maximum.at(last_ticks, instant_drifts, instants)
    burn_ticks = begins.copy()
    burn_ticks[is_stuck] = ignitions[np.searchsorted(ignitions, begins[is_stuck]) - 1]
    pairs = np.stack([burn_ticks, begins])
    return DriftStarts(
        ticks=begins,
        last_ticks=last_ticks,
        burn_ticks=burn_ticks,
        is_stuck=is_stuck,
        r_ST_N=np.moveaxis(records["r_ST_N"][pairs], -1, 1).astype(float),
        v_ST_N=np.moveaxis(records["v_ST_N"][pairs], -1, 1).astype(float),
        mass=records["mass_kg"][begins].astype(float),
        last_delta_v=(delta_v[begins] - delta_v[np.maximum(begins - 1, 0)]).astype(float),
        instants=instants,
        instant_drifts=instant_drifts,
    )
