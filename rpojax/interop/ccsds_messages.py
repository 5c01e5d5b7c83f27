"""Messages of the CCSDS, a file for each spacecraft: OEM and OPM (502.0-B-2), and AEM (504.0-B-1)."""

import datetime
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np

from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_atomically
from rpojax.interop.spacecraft_states import SpacecraftStates

REFERENCE_FRAME = "EME2000"
"""Name of the simulation's inertial frame N: Sun and Moon are given in the mean equator and equinox of J2000."""

FRAME_NOTES = (
    "EME2000 is the inertial frame of the simulation, in which Sun and Moon are given.",
    "The pole of the Earth and of its gravity is fixed to the z axis of this frame:",
    "precession, nutation and polar motion are not modelled. Time scale: UTC.",
)
"""What the name of the frame does not say."""

BODY_FRAME = "SC_BODY_1"
MessageKind = Literal["oem", "aem", "opm"]
MESSAGE_KINDS: Final[tuple[MessageKind, ...]] = get_args(MessageKind)


def oem(states: SpacecraftStates, created: datetime.datetime) -> str:
    """Orbit ephemeris message: position to 1e-6 m and velocity to 1e-9 m/s at every tick."""
    epochs = states.epochs
    meta = {
        **_object(states),
        "CENTER_NAME": "EARTH",
        "REF_FRAME": REFERENCE_FRAME,
        "TIME_SYSTEM": "UTC",
        "START_TIME": epochs[0],
        "STOP_TIME": epochs[-1],
        "INTERPOLATION": "HERMITE",
        "INTERPOLATION_DEGREE": "7",
    }
    rows = [
        f"{epoch} {_numbers(position, 9)} {_numbers(velocity, 12)}"
        for epoch, position, velocity in zip(epochs, states.position_m / 1e3, states.velocity_m_s / 1e3, strict=True)
    ]
    return _text([*_header("OEM", "2.0", states, created), *_block("META", meta), *rows])


def aem(states: SpacecraftStates, created: datetime.datetime) -> str:
    """Attitude ephemeris message: quaternion from the inertial frame to the body, scalar last, at every tick.

    Its vector part is the axis of the rotation from the inertial axes to those of the body, times the sine of half its
    angle: the conjugate of `q_BN` of this package. Neighbours in time have the same sign. Each time over which an
    attitude is known has a segment of its own.
    """
    epochs, known = np.array(states.epochs), ~np.isnan(states.q[:, 0])
    begins = np.flatnonzero(known & ~np.append(False, known[:-1]))
    ends = np.flatnonzero(known & ~np.append(known[1:], False)) + 1
    segments = [
        _attitude_segment(states, epochs[begin:end].tolist(), states.q[begin:end])
        for begin, end in zip(begins, ends, strict=True)
    ]
    return _text([*_header("AEM", "1.0", states, created), *(line for lines in segments for line in lines)])


def _attitude_segment(states: SpacecraftStates, epochs: list[str], q: np.ndarray) -> list[str]:
    """Lines of a segment with an attitude `q` (ticks, 4) at each epoch."""
    meta = {
        **_object(states),
        "CENTER_NAME": "EARTH",
        "REF_FRAME_A": REFERENCE_FRAME,
        "REF_FRAME_B": BODY_FRAME,
        "ATTITUDE_DIR": "A2B",
        "TIME_SYSTEM": "UTC",
        "START_TIME": epochs[0],
        "STOP_TIME": epochs[-1],
        "ATTITUDE_TYPE": "QUATERNION",
        "QUATERNION_TYPE": "LAST",
    }
    quaternions = ccsds_quaternions(q)
    rows = [f"{epoch} {_numbers(quaternion, 15)}" for epoch, quaternion in zip(epochs, quaternions, strict=True)]
    return [*_block("META", meta), *_inside("DATA", rows)]


def opm(states: SpacecraftStates, created: datetime.datetime) -> str:
    """Orbit parameter message: the state at the first tick."""
    names = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
    position, velocity = states.position_m[0] / 1e3, states.velocity_m_s[0] / 1e3
    values = [*_numbers(position, 9).split(), *_numbers(velocity, 12).split()]
    content = {
        **_object(states),
        "CENTER_NAME": "EARTH",
        "REF_FRAME": REFERENCE_FRAME,
        "TIME_SYSTEM": "UTC",
        "EPOCH": states.epochs[0],
        **dict(zip(names, values, strict=True)),
    }
    return _text([*_header("OPM", "2.0", states, created), *_assignments(content)])


def ccsds_quaternions(q: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) of the CCSDS, scalar last, from `q_BN` (n, 4), scalar first."""
    turned = np.concatenate([-q[:, 1:], q[:, :1]], axis=1)
    signs = np.where(np.sum(turned[1:] * turned[:-1], axis=1) < 0.0, -1.0, 1.0)
    return turned * np.concatenate([np.ones(min(1, len(q))), np.cumprod(signs)])[:, None]


def _object(states: SpacecraftStates) -> dict[str, str]:
    return {"OBJECT_NAME": (states.estimated_of or states.spacecraft).upper(), "OBJECT_ID": "UNKNOWN"}


def _header(kind: str, version: str, states: SpacecraftStates, created: datetime.datetime) -> list[str]:
    return [
        f"CCSDS_{kind}_VERS = {version}",
        *(f"COMMENT {line}" for line in (*states.about, *FRAME_NOTES)),
        *_assignments({"CREATION_DATE": created.isoformat(timespec="seconds"), "ORIGINATOR": "RPOJAX"}),
        "",
    ]


def _block(name: str, content: dict[str, str]) -> list[str]:
    return [*_inside(name, _assignments(content)), ""]


def _inside(name: str, lines: Iterable[str]) -> list[str]:
    return [f"{name}_START", *lines, f"{name}_STOP"]


def _assignments(content: dict[str, str]) -> list[str]:
    width = max(map(len, content))
    return [f"{key:<{width}} = {value}" for key, value in content.items()]


def _numbers(values: np.ndarray, decimals: int) -> str:
    return " ".join(f"{value:.{decimals}f}" for value in values.tolist())


def _text(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"


_WRITERS: Final[dict[MessageKind, Callable[[SpacecraftStates, datetime.datetime], str]]] = {
    "oem": oem,
    "aem": aem,
    "opm": opm,
}


def message_paths(out: Path, spacecraft: Sequence[str]) -> list[Path]:
    """Files of each spacecraft: `NAME_servicer.oem` and `NAME_target.oem` for `NAME.oem`."""
    return [out.with_name(f"{out.stem}_{name}{out.suffix}") for name in spacecraft]


def check_messages(out: Path, spacecraft: Sequence[str], force: bool) -> None:
    """Refuses to write over files that exist unless `force` is set.

    Raises:
        OutputError: naming the file.
    """
    check_replaceable(message_paths(out, spacecraft), force)


def write_messages(states: list[SpacecraftStates], kind: MessageKind, out: Path) -> list[Path]:
    """Writes a message for each spacecraft; returns the paths of the files.

    Raises:
        OutputError: a file cannot be written.
    """
    created = datetime.datetime.now(datetime.UTC).replace(tzinfo=None)
    texts = [_WRITERS[kind](state, created) for state in states]
    paths = message_paths(out, [each.spacecraft for each in states])
    return [write_atomically(path, text.encode()) for path, text in zip(paths, texts, strict=True)]
