"""Every keyword of the orbit messages of the CCSDS (502.0-B-1 to -3), and what a start does with each.

What is in no row, and is neither a comment nor defined by a user, is refused by its name.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal

MessageKind = Literal["OEM", "OMM", "OPM"]
VERSIONS: Final = ("1.0", "2.0", "3.0")


class Use(Enum):
    """What a start does with a keyword."""

    USED = "used"
    IGNORED = "ignored"
    REFUSED = "refused"


@dataclass(frozen=True)
class Keyword:
    """What a start does with a keyword of a message.

    Attributes:
        use: what it does
        why: the reason, or what it is used for; of a refused one, what is expected in its place
        unit: of its number; None of a text or date
    """

    use: Use
    why: str
    unit: str | None = None


def _rows(use: Use, why: str, *names: str) -> dict[str, Keyword]:
    return {name: Keyword(use, why) for name in names}


def _numbers(why: str, **units: str) -> dict[str, Keyword]:
    return {name: Keyword(Use.USED, why, unit) for name, unit in units.items()}


HEADER: Final = _rows(
    Use.IGNORED, "who wrote the message and when", "CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID"
)
_METADATA: Final = (
    _rows(Use.USED, "one object in a message", "OBJECT_NAME", "OBJECT_ID")
    | _rows(Use.USED, "EARTH alone", "CENTER_NAME")
    | _rows(Use.USED, "states are turned from this frame", "REF_FRAME")
    | _rows(Use.USED, "a frame of date is that of this date", "REF_FRAME_EPOCH")
    | _rows(Use.USED, "dates are converted from this scale", "TIME_SYSTEM")
)
_STATE: Final = _rows(Use.USED, "time of the state or the elements", "EPOCH") | _numbers(
    "the state", X="km", Y="km", Z="km", X_DOT="km/s", Y_DOT="km/s", Z_DOT="km/s"
)
_BODY: Final = _rows(
    Use.IGNORED,
    "mass and areas are the scenario's",
    *("MASS", "SOLAR_RAD_AREA", "SOLAR_RAD_COEFF", "DRAG_AREA", "DRAG_COEFF"),
)
_AXES: Final = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
COVARIANCE: Final = _rows(
    Use.IGNORED,
    "uncertainty is the scenario's",
    "COV_REF_FRAME",
    *(f"C{row}_{column}" for number, row in enumerate(_AXES) for column in _AXES[: number + 1]),
)
OEM_COVARIANCE: Final = COVARIANCE | _rows(Use.IGNORED, "time of a covariance", "EPOCH")
OEM_METADATA: Final = (
    _METADATA
    | _rows(Use.USED, "states lie between them, to a second", "START_TIME", "STOP_TIME")
    | _rows(Use.USED, "a run starts between them", "USEABLE_START_TIME", "USEABLE_STOP_TIME")
    | _rows(Use.IGNORED, "advice; the error is estimated", "INTERPOLATION", "INTERPOLATION_DEGREE")
)
OEM_STATE: Final = _STATE | _rows(Use.IGNORED, "the velocities say it", "X_DDOT", "Y_DDOT", "Z_DDOT")
_ELEMENTS: Final = {
    "ECCENTRICITY": "",
    "INCLINATION": "deg",
    "RA_OF_ASC_NODE": "deg",
    "ARG_OF_PERICENTER": "deg",
    "MEAN_ANOMALY": "deg",
}
_OMM: Final = (
    HEADER
    | _METADATA
    | _rows(Use.REFUSED, "none, since SGP4 is in TEME of date", "REF_FRAME_EPOCH")
    | _rows(Use.USED, "SGP4 alone", "MEAN_ELEMENT_THEORY")
    | _rows(Use.USED, "time of the elements", "EPOCH")
    | _numbers("elements of SGP4", MEAN_MOTION="rev/day", **_ELEMENTS)
    | _numbers("drag of SGP4", BSTAR="1/ER", MEAN_MOTION_DOT="rev/day**2", MEAN_MOTION_DDOT="rev/day**3")
    | _numbers("that of SGP4 alone", GM="km**3/s**2")
    | _rows(Use.USED, "0 alone, of SGP4", "EPHEMERIS_TYPE")
    | _rows(Use.REFUSED, "MEAN_MOTION in its place, which SGP4 takes", "SEMI_MAJOR_AXIS")
    | _rows(Use.REFUSED, "the elements of SGP4, not of SGP4-XP", "BTERM", "AGOM")
    | _rows(
        Use.IGNORED,
        "numbers of a catalogue",
        *("CLASSIFICATION_TYPE", "NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH"),
    )
    | _BODY
    | COVARIANCE
)
_OPM: Final = (
    HEADER
    | _METADATA
    | _STATE
    | _numbers("must be those of the state", SEMI_MAJOR_AXIS="km", ECCENTRICITY="", INCLINATION="deg")
    | _rows(
        Use.IGNORED,
        "the state says the same",
        *("RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "TRUE_ANOMALY", "MEAN_ANOMALY", "GM"),
    )
    | _BODY
    | COVARIANCE
    | _rows(
        Use.REFUSED,
        "no maneuver, which the run would not make",
        *("MAN_EPOCH_IGNITION", "MAN_DURATION", "MAN_DELTA_MASS", "MAN_REF_FRAME", "MAN_DV_1", "MAN_DV_2", "MAN_DV_3"),
    )
)
KEYWORDS: Final[dict[MessageKind, dict[str, Keyword]]] = {
    "OEM": HEADER | OEM_METADATA | OEM_STATE | OEM_COVARIANCE | _STATE,
    "OMM": _OMM,
    "OPM": _OPM,
}
"""Keywords of a message, wherever in it they stand."""


def is_free(name: str) -> bool:
    """Whether a keyword is a comment or defined by a user, of which no standard says what it means."""
    return name == "COMMENT" or name.startswith("USER_DEFINED")
