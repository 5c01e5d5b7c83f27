"""Draws the figures of docs/theory/relative_motion.md, one for each kind of reference trajectory:

python experiments/missions/draw_references.py --out docs/images/references
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references import approach, fly_around, hold, relative_orbit, retreat, transfer
from rpojax.flight.guidance.references.impulsive_tracking import tracked_point
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.report.figures.colours import BLUE, GRID, INK, MUTED, VERMILLION
from rpojax.runtime.jax_configuration import enable_double_precision

PERIGEE = 6.9e6
PERIGEE_ARGUMENT = math.radians(90.0)
TARGET_SHARE = 0.5
"""The target is shown where the extent of the motion is larger than this share of the distance from it."""
SAMPLES_PER_ARC = 61


@dataclass(frozen=True)
class Example:
    """Reference on an orbit.

    Attributes:
        label: in the legend
        module: of the kind
        reference: its parameters
        entry: relative state at the entry (6,)
        e: eccentricity of the target's orbit
        duration: that is drawn [s]
        period: between burns [s]
    """

    label: str
    module: ModuleType
    reference: Any
    entry: tuple[float, ...]
    e: float
    duration: float
    period: float = 200.0


def main() -> None:
    """Draws all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    folder = parser.parse_args().out
    enable_double_precision()
    folder.mkdir(parents=True, exist_ok=True)
    for name, examples in figures().items():
        draw(examples).savefig(folder / f"{name}.png", dpi=100)


def figures() -> dict[str, list[Example]]:
    """Examples of each figure by its name."""
    circular, elliptic = "circular orbit", "e = 0.7"
    still = (0.0, 0.0, 0.0)
    away = (20.0, -60.0, 10.0, *still)
    one, two = orbital_period(0.0), orbital_period(0.7)
    safe = record(
        relative_orbit.RelativeOrbit,
        radial=30.0,
        radial_phase=0.5,
        cross_track=40.0,
        cross_track_phase=0.5,
        along_track=0.0,
        drift_per_orbit=0.0,
        join=orbital_period(0.0),
    )
    walking = record(relative_orbit.RelativeOrbit, **{**vars(safe), "along_track": -150.0, "drift_per_orbit": 100.0,
                                                      "join": 0.0})  # fmt: skip
    behind = (0.0, -300.0, 0.0, *still)
    on_orbit = on_the_orbit_behind(0.7, 180.0)
    safe_elliptic = record(relative_orbit.RelativeOrbit, **{**vars(safe), "join": 0.5 * two})
    drift = (-60.0, -1500.0, 80.0, 0.0, 0.1, 0.0)
    two_impulses = record(transfer.Transfer, position=(0.0, -100.0, 0.0), duration=2400.0, pulses=2.0, speed_ratio=0.2)
    slope = record(transfer.Transfer, **{**vars(two_impulses), "pulses": 8.0})
    circle = record(
        fly_around.FlyAround, radius=50.0, axis=(0.5, 0.0, 1.0), rate=math.radians(360.0) / 6000.0, join=600.0
    )
    line = record(
        approach.Approach, end_position=(0.0, -12.0, 0.0), max_speed=0.1, time_constant=500.0, final_speed=0.02
    )
    back = record(retreat.Retreat, distance=300.0, speed=0.2)
    near = (5.0, -12.0, 3.0, *still)
    hundred = (6.0, -100.0, -8.0, *still)
    station = record(hold.Hold, position=away[:3])
    return {
        "hold": [Example(circular, hold, station, away, 0.0, 3000.0, 600.0),
                 Example(elliptic, hold, station, away, 0.7, 3000.0, 600.0)],
        "relative_orbit": [Example(circular + ", safety ellipse", relative_orbit, safe, behind, 0.0, 3.0 * one),
                           Example(circular + ", walking", relative_orbit, walking, behind, 0.0, 3.0 * one),
                           Example(elliptic + ", safety ellipse", relative_orbit, safe_elliptic, on_orbit, 0.7,
                                   1.5 * two)],
        "transfer": [Example(circular + ", two impulses", transfer, two_impulses, drift, 0.0, 3000.0, 2400.0),
                     Example(circular + ", glide slope", transfer, slope, drift, 0.0, 3000.0, 2400.0 / 7.0),
                     Example(elliptic + ", two impulses", transfer, two_impulses, drift, 0.7, 3000.0, 2400.0)],
        "fly_around": [Example(circular, fly_around, circle, away, 0.0, 6600.0),
                       Example(elliptic, fly_around, circle, away, 0.7, 6600.0)],
        "approach": [Example(circular, approach, line, hundred, 0.0, 2400.0),
                     Example(elliptic, approach, line, hundred, 0.7, 2400.0)],
        "retreat": [Example(circular, retreat, back, near, 0.0, 1800.0),
                    Example(elliptic, retreat, back, near, 0.7, 1800.0)],
    }  # fmt: skip


def record(kind: Any, **values: Any) -> Any:
    """Record of a kind from numbers."""
    return kind(**{name: None if value is None else jnp.asarray(value) for name, value in values.items()})


def target(e: float) -> TargetOrbit:
    """Orbit at its perigee."""
    elements = (PERIGEE_ARGUMENT, e * math.cos(PERIGEE_ARGUMENT), e * math.sin(PERIGEE_ARGUMENT), PERIGEE / (1.0 - e))
    u, ex, ey, a = map(jnp.asarray, elements)
    return TargetOrbit(argument_of_latitude=u, ex=ex, ey=ey, semi_major_axis=a)


def on_the_orbit_behind(e: float, distance: float) -> tuple[float, ...]:
    """Relative state (6,) at the perigee on the target's own orbit, by a time in which it moves by a distance [m].

    The distance is that at the semi-latus rectum.
    """
    orbit = target(e)
    constants = -distance * jnp.array([1.0, orbit.ey, -orbit.ex, 0.0, 0.0, 0.0])
    return tuple(map(float, yamanaka_ankersen.free_motion(orbit, jnp.asarray(0.0), constants)))


def orbital_period(e: float) -> float:
    """Period of the orbit [s]."""
    return float(2.0 * math.pi / mean_motion(jnp.asarray(PERIGEE / (1.0 - e))))


def flown(example: Example) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times [s] and positions [m] of the free arcs between burns, places of these, and the velocity change [m/s]."""
    start, period = target(example.e), jnp.asarray(example.period)
    entry = PhaseEntry(relative_state=jnp.asarray(example.entry), orbit=start)

    def position(elapsed: jax.Array) -> jax.Array:
        orbit = yamanaka_ankersen.advanced(start, elapsed)
        return example.module.state(example.reference, entry, orbit, elapsed)[:3]

    @jax.jit
    def arc(time: jax.Array) -> tuple[jax.Array, jax.Array]:
        orbit = yamanaka_ankersen.advanced(start, time)
        points = [position(time + shift) for shift in (-period, jnp.zeros_like(period), period)]
        burn = tracked_point(orbit, period, *points)
        state = jnp.concatenate([points[1], burn.arrival_velocity + burn.impulse])
        constants = yamanaka_ankersen.constants_of_motion(orbit, state)

        def free(since: jax.Array) -> jax.Array:
            return yamanaka_ankersen.free_motion(yamanaka_ankersen.advanced(orbit, since), since, constants)[:3]

        return jax.vmap(free)(jnp.linspace(0.0, period, SAMPLES_PER_ARC)), burn.impulse

    burns = example.period * np.arange(math.ceil(example.duration / example.period))
    arcs, impulses = jax.lax.map(arc, jnp.asarray(burns))
    times = burns[:, None] + np.linspace(0.0, example.period, SAMPLES_PER_ARC)
    positions = np.asarray(arcs)
    return times.ravel(), positions.reshape(-1, 3), positions[:, 0], float(np.sum(np.linalg.norm(impulses, axis=1)))


def draw(examples: list[Example]) -> Figure:
    """Motion in the orbit plane, seen along-track, and the range over time."""
    figure = Figure(figsize=(10.0, 3.4), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    plane, along, distance = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 1.1))
    for example, color in zip(examples, (BLUE, INK, VERMILLION) if len(examples) == 3 else (BLUE, VERMILLION),
                              strict=True):  # fmt: skip
        times, path, burns, delta_v = flown(example)
        label = f"{example.label}: {delta_v:.2f} m/s"
        for axes, horizontal in ((plane, 1), (along, 2)):
            axes.plot(path[:, horizontal], path[:, 0], color=color, lw=1.2, label=label)
            axes.plot(burns[:, horizontal], burns[:, 0], ".", color=color, ms=4.0)
            if np.max(np.ptp(path, axis=0)) > TARGET_SHARE * np.max(np.abs(path)):
                axes.plot(0.0, 0.0, "s", color=MUTED, ms=5.0)
        distance.plot(times / 60.0, np.linalg.norm(path, axis=1), color=color, lw=1.2)
    _label(plane, "y along-track [m]", "x radial [m]", "In the orbit plane")
    _label(along, "z cross-track [m]", "x radial [m]", "Along the track")
    _label(distance, "time from the entry [min]", "range [m]", "Range")
    figure.legend(*plane.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def _label(axes: Axes, horizontal: str, vertical: str, title: str) -> None:
    axes.set_xlabel(horizontal, fontsize=8, color=INK)
    axes.set_ylabel(vertical, fontsize=8, color=INK)
    axes.set_title(title, fontsize=9, color=INK)
    axes.tick_params(labelsize=7, colors=MUTED)
    axes.grid(color=GRID, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
