"""What stays the same during a run that is played back: camera, thruster, bodies, zones of each phase, and the Sun."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.core.orbits import eclipse, sun_moon_ephemeris
from rpojax.physics.thruster import Thruster
from rpojax.report.drawn_scenarios import camera_axes
from rpojax.scenario.numbers.section_records import record_of
from rpojax.value_types import epoch_seconds

_CHORD_S: Final = 60.0
"""Time to both sides of an instant over which the plane of the orbit is taken from positions in single precision."""
_LONGEST_CHORD: Final = 0.7
"""Longest angle of that chord [rad], so that thinned histories of low orbits still have a plane."""


@dataclass(frozen=True)
class Optics:
    """True camera of a servicer: frame [px], focal length [px], and `R_KB`."""

    width_px: int
    height_px: int
    focal_px: float
    R_KB: np.ndarray


def optics(tables: Mapping[str, Any]) -> Optics:
    """The true camera of a servicer's scenario."""
    table = tables["camera"]
    focal = _focal_px(table["width_px"], table["field_of_view_deg"])
    return Optics(int(table["width_px"]), int(table["height_px"]), focal, camera_axes(tables))


def focal_lengths(tables: Mapping[str, Any], wide_lens: np.ndarray) -> np.ndarray:
    """Focal lengths (n,) [px] of a camera with two lenses, by whether frames (n,) are of the wide one."""
    width_px = tables["camera"]["width_px"]
    far, near = (_focal_px(width_px, tables[name]["field_of_view_deg"]) for name in ("camera", "wide_lens"))
    return np.where(np.asarray(wide_lens, dtype=bool), near, far)


def _focal_px(width_px: int, field_of_view_deg: float) -> float:
    return 0.5 * width_px / math.tan(0.5 * math.radians(field_of_view_deg))


def thrust_direction(tables: Mapping[str, Any]) -> np.ndarray:
    """Unit vector (3,) of the force on the servicer in B, with the run's misalignment."""
    thruster = record_of(Thruster, tables, "thruster")
    turned = Rotation.from_rotvec(np.array(thruster.misalignment)).apply(np.array(thruster.direction))
    return turned / np.linalg.norm(turned)


def body_side(tables: Mapping[str, Any]) -> float:
    """Side of the cube that stands for the servicer [m]: that of its mean cross-section."""
    return float(np.sqrt(tables["servicer_surface"]["area_m2"]))


def zones(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Semi-axes of the keep-out zone [m] and the corridor of each phase, in order; of the whole run without phases.

    The zone is in Hill axes; a corridor `turns` where its axis is in those of the target. The last entry is that of
    the built-in phases, which have a sphere and no corridor.
    """
    sphere = [float(tables["limits"]["keep_out_m"])] * 3
    phases = [*(tables.get("phases") or []), {}]
    return [{"keep_out": list(phase.get("keep_out_m") or sphere), "corridor": _corridor(phase)} for phase in phases]


def _corridor(phase: Mapping[str, Any]) -> dict[str, Any] | None:
    table = phase.get("corridor")
    if table is None:
        return None
    axis = np.asarray(table["axis"], dtype=np.float64)
    slope = math.tan(math.radians(table["half_angle_deg"]))
    return {
        "axis": (axis / np.linalg.norm(axis)).tolist(),
        "slope": slope,
        "width": float(table["width_m"]),
        "turns": phase.get("frame") == "target",
    }


def hill_axes(time_s: np.ndarray, r_TN_N: np.ndarray) -> np.ndarray:
    """`R_HN` (n, 3, 3) of positions (n, 3) along an orbit [m], whose plane is that of positions a minute apart."""
    r = np.asarray(r_TN_N, dtype=np.float64)
    radial = r / np.linalg.norm(r, axis=1)[:, None]
    step = float(np.median(np.diff(time_s)))
    turned = math.acos(min(1.0, float(radial[0] @ radial[1])))
    reach = min(_CHORD_S / step, _LONGEST_CHORD / max(turned, 1e-12))
    reach = min(max(1, round(reach)), len(r) - 1)
    ticks = np.arange(len(r))
    plane = np.cross(r[np.maximum(ticks - reach, 0)], r[np.minimum(ticks + reach, len(r) - 1)])
    normal = plane - np.sum(plane * radial, axis=1)[:, None] * radial
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return np.stack([radial, np.cross(normal, radial), normal], axis=1)


def sunlight(epoch_utc: str, time_s: np.ndarray, r_TN_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (n, 3) in N from the target to the Sun, and visible fraction (n,) of its disc."""
    epoch = sun_moon_ephemeris.epoch_at(epoch_seconds(epoch_utc))

    def of_instant(time: jax.Array, r_N: jax.Array) -> tuple[jax.Array, jax.Array]:
        sun_N = sun_moon_ephemeris.sun_position(time, epoch)
        return sun_N - r_N, eclipse.illumination(r_N, sun_N)

    instants = jnp.asarray(time_s, dtype=jnp.float64), jnp.asarray(r_TN_N, dtype=jnp.float64)
    towards, visible = map(np.asarray, jax.jit(jax.vmap(of_instant))(*instants))
    return towards / np.linalg.norm(towards, axis=1)[:, None], visible
