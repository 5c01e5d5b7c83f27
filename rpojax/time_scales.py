"""Instants of time, from dates in UTC and other time scales and back, with the leap seconds of ERFA.

The one place where dates are read: calendar or day of the year, fractions of any length, `Z` or an offset, second 60.
"""

import functools
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from decimal import Decimal
from typing import Any, Final

TIME_ROUNDING_S: Final = 1e-6
"""More than the rounding of a multiple of a tick (1e-10 s after ten days), and less than any tick [s]."""

PS: Final = 10**12
"""Picoseconds of a second; a spacecraft in low orbit moves 8e-9 m in one."""
SCALES: Final = ("UTC", "TAI", "TT", "GPS", "TDB")
"""Time scales that are converted."""
FIRST_YEAR: Final = 1972
"""Before, UTC had another length of its second and steps of fractions."""

_FORM: Final = re.compile(
    r"(?P<year>\d{4})-(?:(?P<month>\d{2})-(?P<day>\d{2})|(?P<day_of_year>\d{3}))"
    r"(?P<time>[T ](?P<hour>\d{2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,](?P<fraction>\d+))?)?"
    r"(?P<zone>Z|[+-]\d{2}(?::?\d{2})?)?)?",
    re.ASCII,
)
_A_DATE: Final = "a date and time such as '2026-03-20T14:46:00'"
_IN_LEAP_SECONDS: Final = f"a date since {FIRST_YEAR}, when UTC began to have leap seconds"
_NOON_DAY: Final = date(2000, 1, 1).toordinal()
_HALF_DAY: Final = 43200
_DAY: Final = 86400
_J2000_DAY: Final = 2451545.0
_TAI_LESS: Final = {"TAI": 0, "TT": -32_184 * PS // 1000, "TDB": -32_184 * PS // 1000, "GPS": 19 * PS}
"""TAI less another scale [ps]; less a periodic difference of milliseconds for TDB."""
_LABEL_PS: Final = 50
_TIDY_DECIMALS: Final = (0, 6, 9, 12)


@dataclass(frozen=True, order=True)
class Instant:
    """A point in time.

    Attributes:
        tai_ps: international atomic time since 2000-01-01 12:00 [ps]
    """

    tai_ps: int

    def __sub__(self, earlier: "Instant") -> float:
        """Time between two instants [s], leap seconds counted."""
        return (self.tai_ps - earlier.tai_ps) / PS

    def after(self, seconds: float) -> "Instant":
        """Instant that many seconds later."""
        return Instant(self.tai_ps + round(Decimal(seconds) * PS))

    @property
    def terrestrial_s(self) -> float:
        """Terrestrial time since 2000-01-01 12:00 [s]."""
        return (self.tai_ps - _TAI_LESS["TT"]) / PS

    @property
    def utc_days(self) -> float:
        """Days of UTC since 2000-01-01 12:00, as in Julian dates of ERFA without the day of a leap second."""
        starts, offsets = _leap_seconds()
        return (self.tai_ps / PS - offsets[bisect_right(starts, self.tai_ps // PS) - 1]) / _DAY

    def utc(self, decimals: int | None = None) -> str:
        """Date and time in UTC, by default with as many decimals of the second as are needed, of 0, 6, 9 and 12."""
        if decimals is None:
            decimals = next(each for each in _TIDY_DECIMALS if self.tai_ps % 10 ** (12 - each) == 0)
        return _utc_text(*divmod(_rounded(self.tai_ps, decimals), PS), decimals)


def instant(text: str, scale: str = "UTC") -> Instant:
    """Instant of a date and time in a time scale of `SCALES`; a date alone is its midnight.

    Raises:
        ValueError: saying what is expected, such as `a date of the calendar`.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise ValueError(_A_DATE)
    part = found.groupdict()
    hour, minute, second = (int(part[name] or 0) for name in ("hour", "minute", "second"))
    if hour > 23 or minute > 59 or second > 60:
        raise ValueError("hours to 23, minutes to 59 and seconds to 59, or 60 in a leap second")
    if scale != "UTC" and part["zone"]:
        raise ValueError(f"a date in {scale}, without {part['zone']}, which belongs to UTC")
    days, minutes = divmod((_day(part) - _NOON_DAY) * 1440 + 60 * hour + minute - _offset_min(part["zone"]), 1440)
    ps = round(Decimal(f"0.{part['fraction'] or 0}") * PS)
    if not FIRST_YEAR <= (year := _year(days)) < date.max.year:
        raise ValueError(_IN_LEAP_SECONDS)
    if second == 60 and not (scale == "UTC" and minutes == 1439 and _tai_less_utc(days + 1) > _tai_less_utc(days)):
        raise ValueError("second 60 in leap seconds of UTC alone")
    since_noon = (days * _DAY + 60 * minutes + second - _HALF_DAY) * PS + ps
    if scale == "UTC":
        return Instant(since_noon + _tai_less_utc(days) * PS)
    if not leap_seconds_are_known(year):
        raise ValueError(f"a date in UTC, since leap seconds to {year} are not known")
    periodic = _barycentric_less_terrestrial(since_noon) if scale == "TDB" else 0
    found_at = Instant(since_noon + _TAI_LESS[scale] - periodic)
    if found_at.tai_ps < _leap_seconds()[0][0] * PS:
        raise ValueError(_IN_LEAP_SECONDS)
    return found_at


def leap_seconds_are_known(year: int) -> bool:
    """Whether ERFA's table covers a year; after it, no further leap seconds are assumed."""
    return int(_erfa().ufunc.dat(year, 1, 1, 0.0)[1]) == 0


def utc_texts(instants: Sequence[Instant]) -> list[str]:
    """Dates and times in UTC with 6, 9 or 12 decimals, as many as all of them need to be right to 50 ps.

    A spacecraft in low orbit moves 4e-7 m in that time, and the rounding of times of days is less.
    """
    digits = next(
        (each for each in (6, 9) if all(abs(at.tai_ps - _rounded(at.tai_ps, each)) <= _LABEL_PS for at in instants)), 12
    )
    return [at.utc(digits) for at in instants]


def _rounded(ps: int, decimals: int) -> int:
    step = 10 ** (12 - decimals)
    return (ps + step // 2) // step * step


def _day(part: dict[str, Any]) -> int:
    """Ordinal of a date."""
    try:
        if part["day_of_year"] is None:
            return date(int(part["year"]), int(part["month"]), int(part["day"])).toordinal()
        found = date(int(part["year"]), 1, 1) + timedelta(days=int(part["day_of_year"]) - 1)
    except (ValueError, OverflowError):
        raise ValueError("a date and time of the calendar") from None
    if found.year != int(part["year"]):
        raise ValueError("a date and time of the calendar")
    return found.toordinal()


def _year(days: int) -> int:
    return date.fromordinal(max(1, min(days + _NOON_DAY, date.max.toordinal()))).year


def _offset_min(zone: str | None) -> int:
    """Minutes by which a zone is ahead of UTC."""
    if zone is None or zone == "Z":
        return 0
    hours, minutes = int(zone[1:3]), int(zone[-2:]) if len(zone) > 3 else 0
    if hours > 23 or minutes > 59:
        raise ValueError("an offset from UTC such as +02:00")
    return (60 * hours + minutes) * (-1 if zone[0] == "-" else 1)


def _utc_text(second: int, ps: int, decimals: int) -> str:
    """Text of whole seconds of TAI since noon, and picoseconds."""
    starts, offsets = _leap_seconds()
    at = bisect_right(starts, second) - 1
    leap = int(at + 1 < len(starts) and second == starts[at + 1] - 1)
    days, of_day = divmod(second - leap - offsets[at] + _HALF_DAY, _DAY)
    minutes, last = divmod(of_day, 60)
    fraction = f".{ps:012d}"[: decimals + 1] if decimals else ""
    day = date.fromordinal(days + _NOON_DAY).isoformat()
    return f"{day}T{minutes // 60:02d}:{minutes % 60:02d}:{last + leap:02d}{fraction}"


def _barycentric_less_terrestrial(since_noon_ps: int) -> int:
    """TDB less TT at the centre of the Earth [ps] (Fairhead and Bretagnon 1990, to some nanoseconds)."""
    return round(float(_erfa().dtdb(_J2000_DAY, since_noon_ps / PS / _DAY, 0.0, 0.0, 0.0, 0.0)) * PS)


def _tai_less_utc(days: int) -> int:
    """TAI less UTC [s] on a day, by its number since 2000-01-01."""
    days_of, offsets = _table()
    return offsets[bisect_right(days_of, days) - 1]


@functools.cache
def _leap_seconds() -> tuple[list[int], list[int]]:
    """Whole seconds of TAI since noon at which a value of TAI less UTC begins, and these values [s]."""
    days, offsets = _table()
    return [day * _DAY - _HALF_DAY + offset for day, offset in zip(days, offsets, strict=True)], offsets


@functools.cache
def _table() -> tuple[list[int], list[int]]:
    """Days since 2000-01-01 on which a value of TAI less UTC begins, and these values [s]."""
    rows = [row for row in _erfa().leap_seconds.get() if int(row["year"]) >= FIRST_YEAR]
    days = [date(int(row["year"]), int(row["month"]), 1).toordinal() - _NOON_DAY for row in rows]
    return days, [int(row["tai_utc"]) for row in rows]


def _erfa() -> Any:
    """ERFA, imported late: it imports numpy, which `--help` does not need."""
    import erfa

    return erfa
