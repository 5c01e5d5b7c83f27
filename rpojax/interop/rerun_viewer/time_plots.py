"""Plots of a run over simulation time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.interop.rerun_viewer.data_columns import Chunks
from rpojax.interop.rerun_viewer.viewer_values import Shown
from rpojax.interop.run_replay import Flight

PLOTS = "plots"
MODE = f"{PLOTS}/mode"

Color = tuple[int, int, int]

_BLUE: Color = (86, 180, 233)
_RED: Color = (220, 80, 60)
_AXES: tuple[Color, ...] = ((230, 100, 90), (90, 200, 120), (100, 140, 250))
_SIGMAS = 3.0
_MODES: dict[Mode, tuple[str, Color]] = {
    Mode.LOOK: ("look", (47, 160, 120)),
    Mode.TURN: ("turn", (120, 130, 150)),
    Mode.BURN: ("burn", (255, 90, 60)),
    Mode.TURN_BACK: ("turn back", (150, 160, 180)),
    Mode.SEARCH: ("search", (230, 160, 0)),
}


@dataclass(frozen=True)
class Plot:
    """Lines over time that share an axis.

    Attributes:
        name: of its entity below `plots`
        title: with the unit
        lines: name of each line
        colors: of each line
        values: (ticks, lines)
    """

    name: str
    title: str
    lines: tuple[str, ...]
    colors: tuple[Color, ...]
    values: np.ndarray


def plots(flight: Flight[Shown]) -> list[Plot]:
    """The plots of a run, in the order in which they are read."""
    seen = flight.values
    error = np.linalg.norm(seen["rho_H"] - np.asarray(flight.file.formation.desired_position_m), axis=1)
    return [
        _single("formation_error", "Formation error [m]", error),
        _single("range", "Range [m]", seen["range_m"]),
        *_estimation(flight),
        _single("pointing_error", "Pointing error [deg]", seen["pointing_error_deg"]),
        _single("delta_v", "Delta-v [m/s]", seen["delta_v_m_s"]),
        _wheels("wheel_speed", "Wheel speed [rad/s]", _speed(flight)),
        _wheels("wheel_torque", "Wheel net torque, mean over a tick [mN m]", 1e3 * wheel_torque(flight)),
    ]


def add(chunks: Chunks, flight: Flight[Shown], found: Sequence[Plot]) -> None:
    """Adds plots of a run, and its modes."""
    time = flight.time_s
    for plot in found:
        path = f"{PLOTS}/{plot.name}"
        count, known = len(plot.lines), np.isfinite(plot.values).all(axis=1)
        columns = rr.Scalars.columns(scalars=plot.values[known].astype(np.float64).ravel())
        chunks.add(path, time[known], columns.partition(np.full(int(known.sum()), count)))
        widths = [1.5] + [1.0] * (count - 1)
        chunks.add_static(path, rr.SeriesLines(names=plot.lines, colors=plot.colors, widths=widths))
    _add_mode(chunks, flight)


def wheel_torque(flight: Flight[Shown]) -> np.ndarray:
    """Net torque on each wheel [N m] (ticks, 3), mean over a tick from the change of speed; nan at the last."""
    time, speed = flight.time_s, _speed(flight)
    rate = np.diff(speed, axis=0) / np.diff(time)[:, None]
    return np.asarray(flight.chosen.plant.wheels.inertia) * np.append(rate, np.full((1, 3), np.nan), axis=0)


def _speed(flight: Flight[Shown]) -> np.ndarray:
    return flight.values["wheel_speed_fraction"] * np.asarray(flight.chosen.plant.wheels.speed_limit)


def _single(name: str, title: str, values: np.ndarray) -> Plot:
    return Plot(name, title, (title.partition(" [")[0].lower(),), (_BLUE,), values[:, None])


def _estimation(flight: Flight[Shown]) -> list[Plot]:
    """Error of the relative position along each Hill axis between its bounds.

    The channels are of the target from the servicer; turned round they are of the servicer from the target, as in the
    scene.
    """
    error = -flight.values["relative_error_H"]
    bound = _SIGMAS * flight.values["relative_sigma_H"]
    return [
        Plot(
            f"estimation_error/{axis}",
            f"Estimation error, {title} [m]",
            ("error", "+3 sigma", "-3 sigma"),
            (_BLUE, _RED, _RED),
            np.stack([error[:, index], bound[:, index], -bound[:, index]], axis=1),
        )
        for index, (axis, title) in enumerate(
            (("radial", "radial"), ("along_track", "along-track"), ("normal", "orbit normal"))
        )
    ]


def _wheels(name: str, title: str, values: np.ndarray) -> Plot:
    return Plot(name, title, ("wheel 1", "wheel 2", "wheel 3"), _AXES, values)


def _add_mode(chunks: Chunks, flight: Flight[Shown]) -> None:
    """The mode as states, of which only changes count."""
    mode = flight.values["mode"]
    changes = np.flatnonzero(np.append(True, np.diff(mode) != 0))
    names = [_MODES[Mode(int(value))][0] for value in mode[changes]]
    chunks.add(MODE, flight.time_s[changes], rr.StateChange.columns(state=names))
    styles = list(_MODES.values())
    chunks.add_static(
        MODE, rr.StateConfiguration(values=[name for name, _ in styles], colors=[color for _, color in styles])
    )
