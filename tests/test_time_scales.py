"""Dates and time scales: against ERFA's own conversions, and the leap seconds that the IERS announced."""

import warnings

import erfa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpojax.time_scales import PS, SCALES, Instant, instant, leap_seconds_are_known, utc_texts

LEAP_SECONDS = [
    *("1972-06-30", "1972-12-31", "1973-12-31", "1974-12-31", "1975-12-31", "1976-12-31", "1977-12-31", "1978-12-31"),
    *("1979-12-31", "1981-06-30", "1982-06-30", "1983-06-30", "1985-06-30", "1987-12-31", "1989-12-31", "1990-12-31"),
    *("1992-06-30", "1993-06-30", "1994-06-30", "1995-12-31", "1997-06-30", "1998-12-31", "2005-12-31", "2008-12-31"),
    *("2012-06-30", "2015-06-30", "2016-12-31"),
]
"""Days with a second 60 (IERS, Bulletin C)."""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2026-03-20T14:46:00", "2026-03-20T14:46:00"),
        ("2026-03-20T14:46:00Z", "2026-03-20T14:46:00"),
        ("2026-079T14:46:00", "2026-03-20T14:46:00"),
        ("2026-079T14:46:00.5Z", "2026-03-20T14:46:00.500000"),
        ("2024-366T00:00:00", "2024-12-31T00:00:00"),
        ("2024-060T00:00:00", "2024-02-29T00:00:00"),
        ("2026-001T23:59:59", "2026-01-01T23:59:59"),
        ("2026-03-20T16:46:00+02:00", "2026-03-20T14:46:00"),
        ("2026-03-20T00:16:00+0530", "2026-03-19T18:46:00"),
        ("2026-03-20T14:46:00-00:00", "2026-03-20T14:46:00"),
        ("2026-01-01T01:00:00+03", "2025-12-31T22:00:00"),
        ("2026-12-31T23:30:00-01:00", "2027-01-01T00:30:00"),
        ("2026-03-20T14:46:00.1", "2026-03-20T14:46:00.100000"),
        ("2026-03-20T14:46:00,25", "2026-03-20T14:46:00.250000"),
        ("2026-03-20T14:46:00.123456789", "2026-03-20T14:46:00.123456789"),
        ("2026-03-20T14:46:00.123456789012345678901", "2026-03-20T14:46:00.123456789012"),
        ("2026-03-20T14:46:59." + 5000 * "9", "2026-03-20T14:47:00"),
        ("2026-03-20 14:46", "2026-03-20T14:46:00"),
        ("2026-03-20", "2026-03-20T00:00:00"),
        ("2016-12-31T23:59:60", "2016-12-31T23:59:60"),
        ("2016-12-31T23:59:60.25Z", "2016-12-31T23:59:60.250000"),
        ("2017-01-01T01:59:60.5+02:00", "2016-12-31T23:59:60.500000"),
        ("2016-12-31T18:59:60-05:00", "2016-12-31T23:59:60"),
        ("2016-366T23:59:60", "2016-12-31T23:59:60"),
        ("2016-12-31T23:59:60." + 30 * "9", "2017-01-01T00:00:00"),
        ("1972-01-01T00:00:00", "1972-01-01T00:00:00"),
    ],
)
def test_every_form_of_a_date_is_read(text: str, expected: str) -> None:
    assert instant(text).utc() == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "a date and time such as"),
        ("tomorrow", "a date and time such as"),
        ("20260320T144600", "a date and time such as"),
        ("2026-W12-5", "a date and time such as"),
        ("26-03-20T14:46:00", "a date and time such as"),
        ("2026-03-20T14:46:00 UTC", "a date and time such as"),
        ("2026-03-20T14:46:00.", "a date and time such as"),
        ("2026-03-20T14:46:00z", "a date and time such as"),
        ("\u0662\u0660\u0662\u0666-03-20T14:46:00", "a date and time such as"),
        ("2026-13-20T14:46:00", "of the calendar"),
        ("2026-02-29T14:46:00", "of the calendar"),
        ("2026-000T14:46:00", "of the calendar"),
        ("2026-366T14:46:00", "of the calendar"),
        ("2024-367T14:46:00", "of the calendar"),
        ("2026-03-20T24:00:00", "hours to 23"),
        ("2026-03-20T23:60:00", "minutes to 59"),
        ("2026-03-20T23:59:61", "or 60 in a leap second"),
        ("2026-03-20T23:59:60", "second 60 in leap seconds"),
        ("2017-12-31T23:59:60", "second 60 in leap seconds"),
        ("2016-12-31T23:58:60", "second 60 in leap seconds"),
        ("2016-12-31T23:59:60+01:00", "second 60 in leap seconds"),
        ("2040-12-31T23:59:60", "second 60 in leap seconds"),
        ("2026-03-20T14:46:00+24:00", "an offset"),
        ("2026-03-20T14:46:00+02:75", "an offset"),
        ("1971-12-31T23:59:59", "since 1972"),
        ("1972-01-01T00:30:00+01:00", "since 1972"),
        ("0001-01-01T00:00:00+05:00", "since 1972"),
        ("9999-12-31T23:59:59-05:00", "since 1972"),
    ],
)
def test_what_is_no_date_is_refused_with_what_is_expected(text: str, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        instant(text)


def test_second_60_is_read_on_the_days_that_had_one_and_on_no_other() -> None:
    for day in LEAP_SECONDS:
        before, during, after = (instant(f"{day}T23:59:{second}.9") for second in (58, 59, 60))
        assert (during - before, after - during) == (1.0, 1.0)
        assert after.utc() == f"{day}T23:59:60.900000"
        midnight = instant(f"{int(day[:4]) + (day[5:] == '12-31')}-{'01' if day[5:] == '12-31' else '07'}-01")
        assert (midnight - after, midnight - during) == (0.1, 1.1)
    ends = {f"{year}-{end}" for year in range(1972, 2027) for end in ("06-30", "12-31")}
    for day in ends - set(LEAP_SECONDS):
        with pytest.raises(ValueError, match="second 60"):
            instant(f"{day}T23:59:60")


DATES = [
    *("1972-01-02T00:00:00", "1980-01-06T00:00:00", "1999-08-22T07:11:13.5", "2004-04-06T07:51:28.386009"),
    *("2010-06-01T12:00:00", "2016-12-31T23:59:59.75", "2017-01-01T00:00:00", "2026-03-20T14:46:00.123456789"),
]


def days_tt(text: str, scale: str) -> tuple[float, float]:
    """Julian date in TT in two parts, by ERFA, of a date in a time scale."""
    date, time = text.split("T")
    hour, minute, second = time.split(":")
    as_utc = "UTC" if scale == "UTC" else "TAI"
    parts = erfa.dtf2d(as_utc, *map(int, date.split("-")), int(hour), int(minute), float(second))
    if scale == "GPS":
        return erfa.taitt(parts[0], parts[1] + 19.0 / 86400.0)
    if scale == "TDB":
        return erfa.tdbtt(*parts, erfa.dtdb(*parts, 0.0, 0.0, 0.0, 0.0))
    to_tt = {"UTC": lambda *day: erfa.taitt(*erfa.utctai(*day)), "TAI": erfa.taitt, "TT": lambda *day: day}
    return to_tt[scale](*parts)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("text", DATES)
def test_a_date_in_every_scale_is_the_instant_that_erfa_says_to_a_nanosecond(text: str, scale: str) -> None:
    first, second = days_tt(text, scale)
    # Against the noon of 2000 in TT, in parts, so that no digit is lost.
    seconds = ((first - 2451545.0) + second) * 86400.0
    whole = round(seconds)
    exact = (first - 2451545.0 - whole // 86400) * 86400.0 + second * 86400.0 - whole % 86400
    found = instant(text, scale).tai_ps + 32_184 * PS // 1000 - whole * PS
    assert found / PS == pytest.approx(exact, abs=1e-9)


@given(st.integers(min_value=-883_655_990 * PS, max_value=1_577_800_000 * PS), st.sampled_from([0, 6, 9, 12]))
def test_a_date_that_is_written_is_read_as_it_was(ps: int, decimals: int) -> None:
    tidy = Instant(ps // 10 ** (12 - decimals) * 10 ** (12 - decimals))
    assert instant(tidy.utc(decimals)) == instant(tidy.utc()) == tidy


@pytest.mark.parametrize("zone", ["Z", "+00:00", "-05:00"])
@pytest.mark.parametrize("scale", [scale for scale in SCALES if scale != "UTC"])
def test_an_offset_from_utc_is_refused_in_another_scale(scale: str, zone: str) -> None:
    with pytest.raises(ValueError, match=f"a date in {scale}"):
        instant(f"2026-03-20T14:46:00{zone}", scale)
    with pytest.raises(ValueError, match="second 60"):
        instant("2016-12-31T23:59:60", scale)
    with pytest.raises(ValueError, match="since 1972"):
        instant("1972-01-01T00:00:05", "TAI")


def test_the_table_says_until_when_it_is_known_and_other_scales_end_there() -> None:
    def is_dubious(year: int) -> bool:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            erfa.dat(year, 1, 1, 0.0)
        return bool(said)

    last = max(year for year in range(2017, 2060) if not is_dubious(year))
    assert leap_seconds_are_known(last)
    assert not leap_seconds_are_known(last + 1)
    instant(f"{last}-06-01T00:00:00", "TAI")
    with pytest.raises(ValueError, match=f"leap seconds to {last + 1} are not known"):
        instant(f"{last + 1}-06-01T00:00:00", "TAI")
    assert instant("2049-06-01T00:00:00").utc() == "2049-06-01T00:00:00"


def test_labels_have_the_decimals_that_all_of_them_need() -> None:
    begin = instant("2016-12-31T23:59:59")
    assert utc_texts([begin, begin.after(0.2)]) == ["2016-12-31T23:59:59.000000", "2016-12-31T23:59:59.200000"]
    thirds = utc_texts([begin.after(tick / 3.0) for tick in range(7)])
    assert thirds[0] == "2016-12-31T23:59:59.000000000000"
    assert thirds[4] == "2016-12-31T23:59:60.333333333333"
    assert thirds[6] == "2017-01-01T00:00:00.000000000000"
    assert utc_texts([begin.after(1.0 / 64.0 / 8.0)]) == ["2016-12-31T23:59:59.001953125"]
