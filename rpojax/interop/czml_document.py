"""CZML document of a run for CesiumJS: orbits and attitudes of all spacecraft on the globe, over time."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.interop.run_replay import ReplayedRun
from rpojax.interop.spacecraft_states import TARGET, BothStates, SpacecraftStates

_COLOURS: Final = ((86, 180, 233), (47, 214, 163), (230, 159, 0), (204, 121, 167))
_TARGET_COLOUR: Final = (214, 170, 80)
_KEEP_OUT_COLOUR: Final = (213, 94, 0)
_J2000_DAY: Final = 2451545.0


@dataclass(frozen=True)
class SpacecraftShapes:
    """Shapes that a document shows.

    Attributes:
        boxes_m: (3,) sides of the box of each spacecraft along its body axes, in the order of the states
        keep_out_m: radius of the keep-out sphere about the target, the widest of a team's servicers
    """

    boxes_m: tuple[np.ndarray, ...]
    keep_out_m: float


def shapes_of(runs: Sequence[ReplayedRun[BothStates]]) -> SpacecraftShapes:
    """Extents of the target's hull, a cube with the area of each servicer, and the keep-out sphere, as in the run."""
    servicers = [np.full(3, np.sqrt(float(run.params.plant.servicer_surface.area))) for run in runs]
    hull, keep_out = (
        np.asarray(runs[0].params.plant.target.true_hull),
        max(float(run.params.limits.keep_out) for run in runs),
    )
    return SpacecraftShapes((*servicers, np.ptp(hull, axis=0)), keep_out)


def czml(states: Sequence[SpacecraftStates], shapes: SpacecraftShapes) -> str:
    """CZML document in JSON: a packet for each spacecraft and, from each servicer, a line of sight to the target.

    Positions are in the inertial frame at every tick; attitudes turn body axes to Earth-fixed axes, as the format
    demands.
    """
    target = next(state for state in states if state.spacecraft == TARGET)
    packets = [_document(target)]
    for number, (each, box) in enumerate(zip(states, shapes.boxes_m, strict=True)):
        colour = _TARGET_COLOUR if each is target else _COLOURS[number % len(_COLOURS)]
        packets.append(_spacecraft(each, box, colour))
        if each is target:
            packets[-1]["ellipsoid"] = _keep_out_sphere(shapes.keep_out_m)
        else:
            packets.append(_line_of_sight(each, colour))
    return json.dumps(packets, allow_nan=False, separators=(",", ":"))


def earth_fixed_attitudes(states: SpacecraftStates) -> np.ndarray:
    """Quaternions (ticks, 4), scalar last, that turn components in body axes to those in Earth-fixed axes.

    Earth rotation, precession and nutation of IAU 2006/2000A by ERFA, without polar motion, UT1 being UTC. Neighbours
    in time have the same sign.
    """
    import erfa
    from scipy.spatial.transform import Rotation

    days = states.time_s / 86400.0
    terrestrial, universal = states.epoch.terrestrial_s / 86400.0 + days, states.epoch.utc_days + days
    R_EN = erfa.c2t06a(_J2000_DAY, terrestrial, _J2000_DAY, universal, 0.0, 0.0)
    R_BN = Rotation.from_quat(states.q, scalar_first=True)
    turned = (Rotation.from_matrix(R_EN) * R_BN.inv()).as_quat()
    signs = np.where(np.sum(turned[1:] * turned[:-1], axis=1) < 0.0, -1.0, 1.0)
    return turned * np.append(1.0, np.cumprod(signs))[:, None]


def _document(states: SpacecraftStates) -> dict[str, Any]:
    epochs = states.epochs
    clock = {"interval": _interval(states), "currentTime": f"{epochs[0]}Z", "multiplier": 10, "range": "CLAMPED"}
    description = " ".join(f"{line}." for line in states.about)
    return {"id": "document", "name": "rpojax", "version": "1.0", "description": description, "clock": clock}


def _spacecraft(states: SpacecraftStates, box_m: np.ndarray, colour: tuple[int, ...]) -> dict[str, Any]:
    epoch = f"{states.epochs[0]}Z"
    position = {
        "epoch": epoch,
        "referenceFrame": "INERTIAL",
        "interpolationAlgorithm": "LAGRANGE",
        "interpolationDegree": 5,
        "cartesian": _samples(states.time_s, states.position_m),
    }
    orientation = {
        "epoch": epoch,
        "interpolationAlgorithm": "LINEAR",
        "interpolationDegree": 1,
        "unitQuaternion": _samples(states.time_s, earth_fixed_attitudes(states)),
    }
    sides = {"cartesian": box_m.tolist()}
    return {
        "id": states.spacecraft,
        "name": states.spacecraft,
        "availability": _interval(states),
        "position": position,
        "orientation": orientation,
        "viewFrom": {"cartesian": [-60.0, -60.0, 40.0]},
        "box": {"dimensions": sides, "material": _solid(colour, 255), "outline": False},
        "point": {"pixelSize": 6, "color": {"rgba": [*colour, 255]}},
        "label": {"text": states.spacecraft, "font": "14px sans-serif", "pixelOffset": {"cartesian2": [0.0, -18.0]}},
        "path": {"material": _solid(colour, 180), "width": 2, "leadTime": 0, "trailTime": 6000, "resolution": 30},
    }


def _line_of_sight(states: SpacecraftStates, colour: tuple[int, ...]) -> dict[str, Any]:
    ends = [f"{states.spacecraft}#position", f"{TARGET}#position"]
    line = {"positions": {"references": ends}, "arcType": "NONE", "width": 1, "material": _solid(colour, 90)}
    return {"id": f"{states.spacecraft} to target", "availability": _interval(states), "polyline": line}


def _keep_out_sphere(radius_m: float) -> dict[str, Any]:
    radii, colour = {"cartesian": [radius_m] * 3}, {"rgba": [*_KEEP_OUT_COLOUR, 120]}
    return {"radii": radii, "fill": False, "outline": True, "outlineColor": colour}


def _interval(states: SpacecraftStates) -> str:
    return f"{states.epochs[0]}Z/{states.epochs[-1]}Z"


def _solid(colour: tuple[int, ...], alpha: int) -> dict[str, Any]:
    return {"solidColor": {"color": {"rgba": [*colour, alpha]}}}


def _samples(time_s: np.ndarray, values: np.ndarray) -> list[float]:
    """Time [s] and components of every tick in turn."""
    return np.concatenate([(time_s - time_s[0])[:, None], values], axis=1).ravel().tolist()
