"""Plots of a recording over simulation time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks, ViewerChannels
from rpojax.interop.run_replay import ReplayedRun

PLOTS = "plots"
MODE = f"{PLOTS}/mode"

Color = tuple[int, int, int]

_BLUE: Color = (86, 180, 233)
_RED: Color = (220, 80, 60)
_AXES: tuple[Color, ...] = ((230, 100, 90), (90, 200, 120), (100, 140, 250))
_SIGMAS = 3.0
MODE_STYLES: dict[Mode, tuple[str, Color]] = {
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


def run_plots(run: ReplayedRun[ViewerChannels]) -> list[Plot]:
    """Plots of a run, in their order on the page."""
    channels = run.values
    error = np.linalg.norm(channels["rho_H"] - np.asarray(run.params.flight.formation.desired_position), axis=1)
    return [
        _scalar_plot("formation_error", "Formation error [m]", error),
        _scalar_plot("range", "Range [m]", channels["range_m"]),
        *_estimation_error_plots(run),
        _scalar_plot("pointing_error", "Pointing error [deg]", channels["pointing_error_deg"]),
        _scalar_plot("delta_v", "Delta-v [m/s]", channels["delta_v_m_s"]),
        _wheel_plot("wheel_speed", "Wheel speed [rad/s]", _wheel_speed(run)),
        _wheel_plot("wheel_torque", "Wheel net torque, mean over a tick [mN m]", 1e3 * wheel_torque(run)),
    ]


def add_plots(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels], plots: Sequence[Plot]) -> None:
    """Adds the plots of a run and its guidance modes."""
    time = run.time_s
    for plot in plots:
        path = f"{PLOTS}/{plot.name}"
        count, known = len(plot.lines), np.isfinite(plot.values).all(axis=1)
        columns = rr.Scalars.columns(scalars=plot.values[known].astype(np.float64).ravel())
        chunks.add(path, time[known], columns.partition(np.full(int(known.sum()), count)))
        widths = [1.5] + [1.0] * (count - 1)
        chunks.add_static(path, rr.SeriesLines(names=plot.lines, colors=plot.colors, widths=widths))
    _add_mode(chunks, run)


def wheel_torque(run: ReplayedRun[ViewerChannels]) -> np.ndarray:
    """Net torque on each wheel [N m] (ticks, 3), mean over a tick from the change of speed; nan at the last."""
    time, speed = run.time_s, _wheel_speed(run)
    rate = np.diff(speed, axis=0) / np.diff(time)[:, None]
    return np.asarray(run.params.plant.wheels.inertia) * np.append(rate, np.full((1, 3), np.nan), axis=0)


def _wheel_speed(run: ReplayedRun[ViewerChannels]) -> np.ndarray:
    return run.values["wheel_speed_fraction"] * np.asarray(run.params.plant.wheels.speed_limit)


def _scalar_plot(name: str, title: str, values: np.ndarray) -> Plot:
    return Plot(name, title, (title.partition(" [")[0].lower(),), (_BLUE,), values[:, None])


def _estimation_error_plots(run: ReplayedRun[ViewerChannels]) -> list[Plot]:
    """Error of the relative position along each Hill axis between its bounds.

    The channels are of the target relative to the servicer; with the opposite sign they are of the servicer relative to
    the target, as in the scene.
    """
    error = -run.values["relative_error_H"]
    bound = _SIGMAS * run.values["relative_sigma_H"]
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


def _wheel_plot(name: str, title: str, values: np.ndarray) -> Plot:
    return Plot(name, title, ("wheel 1", "wheel 2", "wheel 3"), _AXES, values)


def _add_mode(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds a state at each change of the mode."""
    mode = run.values["mode"]
    changes = np.flatnonzero(np.append(True, np.diff(mode) != 0))
    names = [MODE_STYLES[Mode(int(value))][0] for value in mode[changes]]
    chunks.add(MODE, run.time_s[changes], rr.StateChange.columns(state=names))
    styles = list(MODE_STYLES.values())
    chunks.add_static(
        MODE, rr.StateConfiguration(values=[name for name, _ in styles], colors=[color for _, color in styles])
    )
