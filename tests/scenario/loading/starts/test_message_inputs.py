"""Orbit messages as other people write them: every keyword, date, time scale, unit and number of objects.

Each is read right, or refused in one line that names what is not.
"""

import dataclasses
import importlib
import io
import math
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgp4.tests
from astropy.time import Time, TimeDelta
from ccsds_ndm.ndm_io import NDMFileFormats, NdmIo
from element_sets import LINES, TLE, with_checksum
from scipy.integrate import solve_ivp
from sgp4 import omm
from sgp4.api import Satrec

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts import inertial_frames, message_keywords, start_files
from rpojax.scenario.loading.starts.message_keywords import KEYWORDS, MessageKind, Use
from rpojax.time_scales import instant

MU = 3.986004418e14
RADIUS_M = 6_878_137.0
RATE = math.sqrt(MU / RADIUS_M**3)
NOON = "2026-03-20T12:00:00"

HEADER = "CREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = SOMEBODY\n"
METADATA = """OBJECT_NAME = SAT
OBJECT_ID = 2020-001A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
"""
OPM = f"""CCSDS_OPM_VERS = 2.0
{HEADER}{METADATA}EPOCH = {NOON}
X = 6878.137
Y = 0.0
Z = 0.0
X_DOT = 0.0
Y_DOT = 4.728554668927
Z_DOT = 5.965951218541
"""
OMM = f"""CCSDS_OMM_VERS = 2.0
{HEADER}OBJECT_NAME = SAT
OBJECT_ID = 2020-001A
CENTER_NAME = EARTH
REF_FRAME = TEME
TIME_SYSTEM = UTC
MEAN_ELEMENT_THEORY = SGP4
EPOCH = {NOON}
MEAN_MOTION = 15.4956
ECCENTRICITY = 0.0006317
INCLINATION = 51.64
RA_OF_ASC_NODE = 208.9163
ARG_OF_PERICENTER = 69.9862
MEAN_ANOMALY = 25.2906
EPHEMERIS_TYPE = 0
BSTAR = 0.0001027
MEAN_MOTION_DOT = 0.00016717
MEAN_MOTION_DDOT = 0.0
"""


def position(seconds: Any, eccentricity: float = 0.0) -> np.ndarray:
    """Positions (n, 3) and velocities (n, 3), side by side [m, m/s], seconds after the perigee."""
    mean = RATE * np.atleast_1d(np.asarray(seconds, dtype=float))
    eccentric = mean.copy()
    for _ in range(50):
        eccentric = eccentric - (eccentric - eccentricity * np.sin(eccentric) - mean) / (
            1.0 - eccentricity * np.cos(eccentric)
        )
    root = math.sqrt(1.0 - eccentricity**2)
    speed = RADIUS_M * RATE / (1.0 - eccentricity * np.cos(eccentric))
    first, second = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6211500577, 0.7836932664])
    second /= np.linalg.norm(second)
    r = RADIUS_M * (np.outer(np.cos(eccentric) - eccentricity, first) + np.outer(root * np.sin(eccentric), second))
    v = np.outer(-speed * np.sin(eccentric), first) + np.outer(root * speed * np.cos(eccentric), second)
    return np.concatenate([r, v], axis=1)


def row(label: str, state: np.ndarray) -> str:
    """Line of an OEM with a state [m, m/s]."""
    return " ".join([label, *(f"{value / 1e3:.12f}" for value in state)])


def labels(begin: Time, seconds: Any, scale: str = "utc") -> list[str]:
    """Dates by astropy, some seconds after a time, in a scale."""
    if scale == "gps":
        begin = begin.tai - TimeDelta(19.0, format="sec")
        scale = "tai"
    times = begin.tai + TimeDelta(np.asarray(seconds, dtype=float), format="sec")
    return Time(getattr(times, scale), precision=9).isot.tolist()


def segment(rows: list[str], extra: str = "", metadata: str = METADATA) -> str:
    """Metadata and states of a segment of an OEM."""
    return f"META_START\n{metadata}{extra}META_STOP\n" + "\n".join(rows) + "\n"


def oem(*segments: str) -> str:
    """An OEM of segments."""
    return f"CCSDS_OEM_VERS = 2.0\n{HEADER}" + "".join(segments)


def orbit_rows(seconds: Any, begin: str = NOON, scale: str = "utc", eccentricity: float = 0.0) -> list[str]:
    """Lines of an OEM of the orbit."""
    texts = labels(Time(begin, scale="utc"), seconds, scale)
    return [row(text, state) for text, state in zip(texts, position(seconds, eccentricity), strict=True)]


OEM = oem(segment(orbit_rows(np.arange(0.0, 301.0, 60.0))))


def start_of(folder: Path, text: str, epoch: str | None = None) -> dict[str, Any]:
    """What a start from a file says: the section `start` and the scenario's `epoch_utc` and `orbit`."""
    path = folder / "start.txt"
    path.write_text(text)
    start: dict[str, Any] = {"target": str(path)} | ({"epoch_utc": epoch} if epoch else {})
    tables: dict[str, Any] = {"start": start}
    start_files.resolve_start(tables)
    return tables["start"] | {"epoch_utc": tables["epoch_utc"], "orbit": tables["orbit"]}


def refusal(folder: Path, text: str, epoch: str | None = None) -> str:
    """The one line with which a file is refused."""
    with pytest.raises(ScenarioError) as caught:
        start_of(folder, text, epoch)
    message = str(caught.value)
    assert message.startswith("start.") and "\n" not in message and ", expected " in message
    return message


def names_of(model: type, found: set[str]) -> set[str]:
    """Keywords of a model of the library ccsds-ndm, those of its parts included."""
    for each in dataclasses.fields(model):
        name = each.metadata.get("name", "")
        if name.isupper() or "_" in name:
            found.add(name)
        for part in [*getattr(each.type, "__args__", ()), each.type]:
            for inner in [*getattr(part, "__args__", ()), part]:
                if dataclasses.is_dataclass(inner) and isinstance(inner, type):
                    names_of(inner, found)
    return found


@pytest.mark.parametrize("kind", ["OEM", "OMM", "OPM"])
@pytest.mark.parametrize(("folder", "version"), [("ndmxml2.ndmxml_2_0_0", "2_0"), ("ndmxml4.ndmxml_4_0_0", "3_0")])
def test_the_table_has_every_keyword_of_the_standard(kind: MessageKind, folder: str, version: str) -> None:
    name = f"ccsds_ndm.models.{folder}_{kind.lower()}_{version}"
    module = importlib.import_module(name)
    models = [getattr(module, each) for each in dir(module) if dataclasses.is_dataclass(getattr(module, each))]
    found: set[str] = set()
    for model in models:
        hints = typing.get_type_hints(model)
        for each in dataclasses.fields(model):
            each.type = hints[each.name]
        names_of(model, found)
    assert len(found) > 30
    missing = {each for each in found if not message_keywords.is_free(each)} - set(KEYWORDS[kind])
    assert missing == set()


def test_the_page_says_of_every_keyword_what_a_start_does() -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")
    section = page.split("### Keywords of orbit messages\n")[1].split("\n### ")[0]
    rows = [line.split("|")[1:4] for line in section.splitlines() if line.startswith("| ") and "`" in line]
    for kind, keywords in KEYWORDS.items():
        for name, keyword in keywords.items():
            shown = "CX_X" if name in message_keywords.COVARIANCE and name != "COV_REF_FRAME" else name
            said = [
                words.lower()
                for kinds, names, words in rows
                if (kind in kinds or "all" in kinds) and f"`{shown}`" in names and "covariance." not in names
            ]
            verb = {Use.USED: "uses", Use.IGNORED: "ignores", Use.REFUSED: "refuses"}[keyword.use]
            assert said and verb in said[0], (kind, name)


def with_keyword(kind: MessageKind, name: str, value: str) -> str:
    """A message with a keyword more, where it belongs."""
    line = f"{name} = {value}\n"
    if kind != "OEM":
        return {"OMM": OMM, "OPM": OPM}[kind] + line
    if name in message_keywords.HEADER:
        return OEM.replace("META_START\n", f"{line}META_START\n")
    if name in message_keywords.OEM_METADATA:
        return OEM.replace("META_STOP\n", f"{line}META_STOP\n")
    return f"{OEM}COVARIANCE_START\n{line}COVARIANCE_STOP\n"


def cases(use: Use) -> Iterator[tuple[MessageKind, str]]:
    """Kinds of messages and those of their keywords with a use."""
    for kind, rows in KEYWORDS.items():
        yield from ((kind, name) for name, found in rows.items() if found.use is use)


BASES: dict[MessageKind, str] = {"OEM": OEM, "OMM": OMM, "OPM": OPM}


@pytest.mark.parametrize("kind", ["OEM", "OMM", "OPM"])
def test_keywords_that_are_ignored_change_nothing(tmp_path: Path, kind: MessageKind) -> None:
    expected = start_of(tmp_path, BASES[kind])
    for _, name in [each for each in cases(Use.IGNORED) if each[0] == kind]:
        if f"{name} =" in BASES[kind] or name in ("X_DDOT", "Y_DDOT", "Z_DDOT"):
            continue
        found = start_of(tmp_path, with_keyword(kind, name, "1.0"))
        assert found | {"target_sha256": ""} == expected | {"target_sha256": ""}, name
    for free in ("COMMENT anything = at all\n", "USER_DEFINED_COLOUR = red\n"):
        text = BASES[kind].replace("ORIGINATOR", f"{free}ORIGINATOR")
        assert start_of(tmp_path, text)["target_position_m"] == expected["target_position_m"]


@pytest.mark.parametrize(("kind", "name"), list(cases(Use.REFUSED)))
def test_keywords_that_a_start_cannot_obey_are_refused_by_their_name(
    tmp_path: Path, kind: MessageKind, name: str
) -> None:
    assert f"found '{name}'" in refusal(tmp_path, with_keyword(kind, name, "1.0"))


@pytest.mark.parametrize("kind", ["OEM", "OMM", "OPM"])
@pytest.mark.parametrize(
    "name",
    [
        *("EPOCH_TIME", "REF_FRAM", "PROPAGATOR", "LEAP_SECONDS", "DELTA_T", "UT1_UTC", "GRAVITY_MODEL", "x"),
        *("USABLE_START_TIME", "Object_Name", "MAN_ID", "TZRMSL"),
    ],
)
def test_keywords_of_no_standard_are_refused_by_their_name(tmp_path: Path, kind: MessageKind, name: str) -> None:
    for place in ("ORIGINATOR", "REF_FRAME"):
        text = BASES[kind].replace(place, f"{name} = 1\n{place}", 1)
        assert f"found '{name}', expected a keyword of" in refusal(tmp_path, text)


@pytest.mark.parametrize("kind", ["OEM", "OMM", "OPM"])
def test_each_keyword_stands_once(tmp_path: Path, kind: MessageKind) -> None:
    lines = [line for line in BASES[kind].splitlines() if "=" in line and "VERS" not in line]
    for line in lines:
        text = BASES[kind].replace(f"{line}\n", f"{line}\n{line}\n", 1)
        assert f"found '{line.split(' =')[0]} once more'" in refusal(tmp_path, text)


@pytest.mark.parametrize("first", [OEM, OMM, OPM, TLE])
@pytest.mark.parametrize("second", [OEM, OMM, OPM, TLE, OMM.replace("SAT", "OTHER"), "0 OTHER\n" + TLE])
def test_two_messages_in_a_file_are_refused(tmp_path: Path, first: str, second: str) -> None:
    refusal(tmp_path, first + second)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (OMM.replace("TYPE = 0", "TYPE = 4"), "EPHEMERIS_TYPE = 4"),
        (OMM.replace("TYPE = 0", "TYPE = 2"), "EPHEMERIS_TYPE = 2"),
        (OMM.replace("= SGP4", "= SGP4-XP"), "MEAN_ELEMENT_THEORY = SGP4-XP"),
        (OMM.replace("= SGP4", "= BROUWER"), "MEAN_ELEMENT_THEORY = BROUWER"),
        (OMM.replace("MEAN_ELEMENT_THEORY = SGP4\n", ""), "no MEAN_ELEMENT_THEORY"),
        (OMM.replace("REF_FRAME = TEME\n", ""), "no REF_FRAME"),
        (OMM.replace("= TEME", "= EME2000"), "REF_FRAME = EME2000"),
        (OMM.replace("= UTC", "= TAI"), "TIME_SYSTEM = TAI"),
        (OMM.replace("= EARTH", "= MOON"), "CENTER_NAME = MOON"),
        (OMM + "GM = 398600.4418\n", "GM = 398600.4418"),
        (OMM.replace("15.4956", "15.4956 [rad/s]"), "a finite number in rev/day"),
        (OMM.replace("51.64", "0.9 [rad]"), "a finite number in deg"),
        (OMM.replace("51.64", "1_0"), "INCLINATION = 1_0"),
        (OMM.replace("MEAN_MOTION =", "SEMI_MAJOR_AXIS ="), "SEMI_MAJOR_AXIS"),
        (OMM.replace("OMM_VERS = 2.0", "OMM_VERS = 4.0"), "OMM version 4.0"),
        (OPM.replace("X = 6878.137", "X = 6878137.0 [m]"), "X = 6878137.0 [m]', expected a finite number in km"),
        (OPM.replace("X = 6878.137", "X = 6878,137"), "X = 6878,137"),
        (OPM.replace("Y = 0.0\n", "", 1), "no Y"),
        (OPM.replace("TIME_SYSTEM = UTC\n", ""), "no TIME_SYSTEM"),
        (OPM.replace("= EARTH", "= SUN"), "CENTER_NAME = SUN"),
        (OPM.replace("EME2000", "ITRF-97"), "the frame ITRF-97"),
        (OPM.replace("OPM", "APM"), "APM version 2.0"),
        (OEM.replace("OEM", "AEM"), "AEM version 2.0"),
        (OEM.replace("CENTER_NAME = EARTH\n", ""), "no CENTER_NAME"),
        (OEM.replace("= EARTH", "= MARS BARYCENTER"), "CENTER_NAME = MARS BARYCENTER"),
        (OEM.replace("EME2000", "RTN"), "the frame RTN"),
        (OEM.replace("META_STOP\n", "", 1), "line 10: found '2026-03-20T12:00:00.000000000"),
        (OEM + "COVARIANCE_START\n", "no end of the block COVARIANCE"),
        (OEM + "COVARIANCE_STOP\n", "COVARIANCE_STOP"),
        (OEM + "DATA_START\n", "DATA_START"),
        (OEM + "COVARIANCE_START\nEPOCH = 1\nSCALE = 2\nCOVARIANCE_STOP\n", "found 'SCALE'"),
        (OEM.replace("META_STOP", "USEABLE_START_TIME = soon\nMETA_STOP"), "USEABLE_START_TIME = soon"),
        (OEM.replace("META_STOP", "STOP_TIME = 2026-03-20T12:03:00\nMETA_STOP"), "START_TIME to STOP_TIME"),
        (OEM.replace("META_STOP", "START_TIME = 2026-03-20T12:00:37\nMETA_STOP"), "START_TIME to STOP_TIME"),
    ],
)
def test_a_keyword_that_means_something_else_is_refused_by_its_name(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refusal(tmp_path, text)


def test_units_that_the_standard_demands_may_be_said(tmp_path: Path) -> None:
    said = OPM.replace("X = 6878.137", "X = 6878.137 [km]").replace("5.965951218541", "5.965951218541 [km/s]")
    assert start_of(tmp_path, said)["target_velocity_m_s"] == start_of(tmp_path, OPM)["target_velocity_m_s"]
    said = OMM.replace("15.4956", "15.4956 [rev/day]").replace("51.64", "51.64 [deg]") + "GM = 398600.8 [km**3/s**2]\n"
    assert start_of(tmp_path, said)["target_position_m"] == start_of(tmp_path, OMM)["target_position_m"]


@pytest.mark.parametrize("kind", ["OEM", "OMM", "OPM"])
def test_a_message_in_xml_is_that_in_key_value_notation(tmp_path: Path, kind: MessageKind) -> None:
    text = BASES[kind]
    if kind == "OEM":
        text = text.replace("META_STOP", f"START_TIME = {NOON}\nSTOP_TIME = 2026-03-20T12:05:00\nMETA_STOP")
    (tmp_path / "message.kvn").write_text(text)
    message = NdmIo().from_path(tmp_path / "message.kvn")
    by_library = NdmIo().to_string(message, data_format=NDMFileFormats.XML)
    assert by_library.lstrip().startswith("<")
    expected, found = start_of(tmp_path, text), start_of(tmp_path, by_library)
    assert found | {"target_sha256": ""} == expected | {"target_sha256": ""}
    name = "OBJECT_NAME"
    assert f"{name} once more" in refusal(tmp_path, by_library.replace(f"<{name}>", f"<{name}>A</{name}><{name}>"))
    assert "'FLATTENING'" in refusal(tmp_path, by_library.replace(f"<{name}>", f"<FLATTENING>1</FLATTENING><{name}>"))
    body = by_library[by_library.index("<segment>") : by_library.index("</segment>") + len("</segment>")]
    if kind != "OEM":
        assert "2 segments" in refusal(tmp_path, by_library.replace(body, body + body))
        wrong = by_library.replace('units="km"', 'units="m"').replace('units="deg"', 'units="rad"')
        if wrong != by_library:
            assert "a finite number in" in refusal(tmp_path, wrong)


def test_an_attribute_of_no_standard_is_refused_by_its_name(tmp_path: Path) -> None:
    fields = [line.split(" = ") for line in (HEADER + METADATA).splitlines()]
    header, metadata = (
        "".join(f"<{name}>{value}</{name}>" for name, value in part) for part in (fields[:2], fields[2:])
    )
    state = "".join(
        f"<{name}>{value}</{name}>" for name, value in [line.split(" = ") for line in OPM.splitlines()[-7:]]
    )
    text = (
        f'<opm id="CCSDS_OPM_VERS" version="2.0"><header>{header}</header><body><segment>'
        f"<metadata>{metadata}</metadata><data><stateVector>{state}</stateVector></data></segment></body></opm>"
    )
    assert start_of(tmp_path, text)["target_position_m"] == [6878137.0, 0.0, 0.0]
    said = refusal(tmp_path, text.replace("<X>6878.137", '<X unit="m">6878137.0'))
    assert "found 'X with unit = m'" in said
    noted = text.replace("<OBJECT_NAME>", "<COMMENT><![CDATA[a < b]]></COMMENT><OBJECT_NAME>")
    assert start_of(tmp_path, noted)["target_position_m"] == [6878137.0, 0.0, 0.0]
    for where in ("<metadata>", "<segment>", "<stateVector>"):
        said = refusal(tmp_path, text.replace(where, f'{where[:-1]} frame="ITRF">'))
        assert f"{where[1:-1]} with frame = ITRF" in said
        assert "found '99 in " in refusal(tmp_path, text.replace(where, f"{where}99 "))
    assert "a document type, as of a web page" in refusal(tmp_path, "<!DOCTYPE html><html></html>")


@pytest.mark.parametrize(
    ("elements", "found"),
    [
        ((6878.137, 0.0, 51.6), None),
        ((6885.2, 0.001, 51.62), None),  # mean elements
        ((7200.0, 0.0, 51.6), "SEMI_MAJOR_AXIS = 7200 beside a state with 6878"),
        ((6878.137, 0.05, 51.6), "ECCENTRICITY = 0.05 beside a state with"),
        ((6878.137, 0.0, 98.0), "INCLINATION = 98 beside a state with 51.6"),
    ],
)
def test_elements_beside_a_state_are_those_of_the_state(
    tmp_path: Path, elements: tuple[float, float, float], found: str | None
) -> None:
    axis, eccentricity, inclination = elements
    further = f"SEMI_MAJOR_AXIS = {axis} [km]\nECCENTRICITY = {eccentricity}\nINCLINATION = {inclination} [deg]\n"
    if found is None:
        assert start_of(tmp_path, OPM + further)["target_position_m"] == [6878137.0, 0.0, 0.0]
    else:
        assert found in refusal(tmp_path, OPM + further)


IN_METRES = row(NOON, 1e3 * position(0.0)[0])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (OPM.replace("6878.137", "6878137.0"), "a state 6.87814e+06 km from the centre of the Earth"),
        (OPM.replace("Z_DOT = 5.9", "Z_DOT = 5965.9"), "at 5965.97 km/s"),
        (
            OPM.replace("Y_DOT = 4.728554668927", "Y_DOT = 0").replace("Z_DOT = 5.965951218541", "Z_DOT = 0"),
            "at 0 km/s",
        ),
        (oem(segment([IN_METRES])), "line 11: found 'a state 6.87814e+06 km"),
        (OEM.replace(f" {position(0.0)[0, 4] / 1e3:.9f}", " 4728.554668"), "line 11: found 'a state 6878.14 km"),
    ],
)
def test_a_state_in_other_units_is_refused_as_such(tmp_path: Path, text: str, found: str) -> None:
    message = refusal(tmp_path, text)
    assert found in message and "in km and km/s" in message


def test_a_state_whose_velocity_is_not_that_of_its_positions_is_refused(tmp_path: Path) -> None:
    seconds = np.arange(0.0, 601.0, 60.0)
    texts, states = labels(Time(NOON, scale="utc"), seconds), position(seconds)
    turning = states.copy()
    turning[:, 3:] -= np.cross([0.0, 0.0, 7.292115e-5], states[:, :3])
    for wrong in (turning, states * [1, 1, 1, -1, -1, -1]):
        text = oem(segment([row(*each) for each in zip(texts, wrong, strict=True)]))
        for epoch in (None, texts[5], texts[-1]):
            assert "a velocity that misses the next state by" in refusal(tmp_path, text, epoch)
    pushed = states.copy()  # by an engine that gives 8 m/s^2
    pushed[:, 2] += 4.0 * seconds**2
    pushed[:, 5] += 8.0 * seconds
    text = oem(segment([row(*each) for each in zip(texts, pushed, strict=True)]))
    found = start_of(tmp_path, text, texts[3])["target_position_m"]
    np.testing.assert_allclose(found, pushed[3, :3], rtol=0.0, atol=1e-5)
    burnt = states.copy()
    burnt[6:] = position(seconds[6:] + 20.0)[:, :]
    text = oem(segment([row(*each) for each in zip(texts, burnt, strict=True)]))
    for number in (5, 6):
        found = start_of(tmp_path, text, texts[number])["target_position_m"]
        np.testing.assert_allclose(found, burnt[number, :3], rtol=0.0, atol=1e-5)


@pytest.mark.parametrize(
    ("text", "looks"),
    [
        ("", "an empty file"),
        ('[{"OBJECT_NAME": "ISS", "EPOCH": "2026-03-20T12:00:00", "MEAN_MOTION": 15.49}]', "JSON"),
        (
            "OBJECT_NAME,OBJECT_ID,EPOCH,MEAN_MOTION,ECCENTRICITY\nISS,1998-067A,2026-03-20,15.49,0.1\n",
            "a table in CSV",
        ),
        ("  " + TLE.replace("\n", "\n  ").rstrip(), "element lines that do not begin in the first column"),
        ("No GP data found\n", "'No GP data found' in its first line"),
        ("stk.v.11.0\nBEGIN Ephemeris\n", "'stk.v.11.0' in its first line"),
    ],
)
def test_a_file_that_is_no_message_is_named_for_what_it_is(tmp_path: Path, text: str, looks: str) -> None:
    assert f"({looks})" in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("0.0006317", "-0.0006317", "eccentricity -0.0006317"),
        ("0.0006317", "0006317", "eccentricity 6317"),
        ("51.64", "251.64", "inclination 251.64 deg"),
        ("51.64", "-51.64", "inclination -51.64 deg"),
    ],
)
def test_elements_beyond_their_ranges_are_refused(tmp_path: Path, old: str, new: str, found: str) -> None:
    assert found in refusal(tmp_path, OMM.replace(old, new))


def test_the_name_of_an_object_may_begin_like_an_element_line(tmp_path: Path) -> None:
    assert start_of(tmp_path, "2 BRAVO\n" + TLE)["target_object"] == "2 BRAVO"


def test_an_omm_of_a_catalogue_is_read_as_sgp4_reads_it(tmp_path: Path) -> None:
    text = sgp4.tests.MARIO_XML
    satellite = Satrec()
    omm.initialize(satellite, next(omm.parse_xml(io.StringIO(text))))
    _, expected, _ = satellite.sgp4_tsince(0.0)
    found = start_of(tmp_path, text)
    assert (found["target_object"], found["epoch_utc"]) == ("MARIO", "2023-04-25T10:45:30.642912")
    R = inertial_frames.to_inertial("TEME", instant(found["epoch_utc"]), "")
    np.testing.assert_allclose(R.T @ found["target_position_m"], 1e3 * np.array(expected), rtol=0.0, atol=1e-3)


GOOD_DATES = [
    *("2026-03-20T12:00:00", "2026-03-20T12:00:00Z", "2026-079T12:00:00", "2026-079T12:00:00Z"),
    *("2026-079T12:00:00.000Z", "2026-03-20T12:00:00.000000000000", "2026-03-20T14:00:00+02:00"),
    *("2026-03-20T12:00:00+00:00", "2026-03-20T06:30:00-05:30", "2026-079T23:00:00+11:00", "2026-080T01:00:00+1300"),
]
BAD_DATES = [
    *("2026-03-20", "2026-03-20T12", "2026-02-30T12:00:00", "2026-400T12:00:00", "2026-03-20T12:00:00+99:00"),
    *("2026-03-20T12:00:60", "2026-03-20T12:00:00 GMT", "20-Mar-2026 12:00:00", "2461120.0", "1962-02-20T14:47:39"),
    *("2026-03-20T25:00:00", "now"),
]


@pytest.mark.parametrize("date", GOOD_DATES)
def test_every_format_reads_every_form_of_a_date(tmp_path: Path, date: str) -> None:
    moved = oem(segment([row(date, position(0.0)[0])]))
    for text in (moved, OMM.replace(NOON, date), OPM.replace(NOON, date)):
        assert start_of(tmp_path, text)["epoch_utc"] == NOON


@pytest.mark.parametrize("date", BAD_DATES)
def test_every_format_refuses_what_is_no_date(tmp_path: Path, date: str) -> None:
    for text in (OMM.replace(NOON, date), OPM.replace(NOON, date)):
        assert f"EPOCH = {date}" in refusal(tmp_path, text)
    assert "start.target line 11" in refusal(tmp_path, oem(segment([row(date, position(0.0)[0])])))
    if date != "2026-03-20":
        assert "start.epoch_utc" in refusal(tmp_path, OPM, date)


@pytest.mark.parametrize("begin", ["1985-06-30T23:58:00", "1999-08-22T11:00:00", "2010-06-01T12:00:00", NOON])
@pytest.mark.parametrize("scale", ["utc", "tai", "gps", "tt", "tdb"])
def test_an_orbit_in_any_scale_is_the_same_start(tmp_path: Path, begin: str, scale: str) -> None:
    seconds = np.arange(0.0, 301.0, 30.0)
    text = oem(segment(orbit_rows(seconds, begin, scale), metadata=METADATA.replace("UTC", scale.upper())))
    at = labels(Time(begin, scale="utc"), [140.0])[0]
    found = start_of(tmp_path, text, at)
    # Labels of astropy have nanoseconds, in which the spacecraft moves by 8e-6 m.
    np.testing.assert_allclose(found["target_position_m"], position(140.0)[0, :3], rtol=0.0, atol=2e-5)
    assert found["orbit"]["eccentricity"] < 1e-8


@pytest.mark.parametrize(
    "scale", ["UT1", "TCB", "TCG", "GMST", "MET", "MRT", "SCLK", "GLONASST", "BDT", "GALILEO", "UTC+2", "ET"]
)
def test_a_scale_that_is_not_converted_is_refused_by_its_name(tmp_path: Path, scale: str) -> None:
    assert f"TIME_SYSTEM = {scale}" in refusal(tmp_path, OEM.replace("= UTC", f"= {scale}"))
    assert f"TIME_SYSTEM = {scale}" in refusal(tmp_path, OPM.replace("= UTC", f"= {scale}"))


@pytest.mark.parametrize("end", ["1972-06-30", "1990-12-31", "2012-06-30", "2016-12-31"])
@pytest.mark.parametrize("offset", [-90.0, -30.0, 0.25, 0.5, 45.0])
def test_an_orbit_over_a_leap_second_is_interpolated_right(tmp_path: Path, end: str, offset: float) -> None:
    begin = Time(f"{end}T23:50:00", scale="utc")
    # 601 s to midnight: rows a minute apart, one in the leap second.
    seconds = np.sort(np.append(np.arange(0.0, 1201.0, 60.0), 600.5))
    text = oem(segment(orbit_rows(seconds, f"{end}T23:50:00")))
    assert f"{end}T23:59:60.500000000" in text
    at = labels(begin, [600.0 + offset])[0]
    found = start_of(tmp_path, text, at)
    np.testing.assert_allclose(found["target_position_m"], position(600.0 + offset)[0, :3], rtol=0.0, atol=1e-4)
    # Labels of nanoseconds beside states half a second apart: 4e-6 m of 0.5 s.
    assert found["orbit"]["eccentricity"] < 1e-8
    assert instant(found["epoch_utc"]) == instant(at)


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("spacing", [10.0, 30.0, 60.0, 120.0, 240.0, 300.0, 450.0, 600.0, 900.0, 1800.0])
@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 20])
def test_an_interpolation_is_right_or_refused(tmp_path: Path, spacing: float, count: int, eccentricity: float) -> None:
    seconds = spacing * np.arange(count)
    text = oem(segment(orbit_rows(seconds, eccentricity=eccentricity)))
    for at in (0.4 * spacing, (count - 1) * spacing / 2.0 + 0.1 * spacing, (count - 1.3) * spacing):
        epoch = labels(Time(NOON, scale="utc"), [at])[0]
        try:
            found = start_of(tmp_path, text, epoch)
        except ScenarioError as error:
            assert "interpolated with an error of" in str(error)
            continue
        off = np.linalg.norm(found["target_position_m"] - position(at, eccentricity)[0, :3])
        assert off < max(2.0 * found["target_interpolation_error_m"], 1e-4)
        assert found["target_interpolation_error_m"] <= 1.0


@pytest.mark.parametrize(
    ("spacing", "count", "accepted"),
    [
        *((60.0, 2, True), (20.0, 16, True), (240.0, 10, True), (300.0, 10, True), (600.0, 10, True)),
        *((1800.0, 20, False), (120.0, 2, False), (3000.0, 2, False)),
    ],
)
def test_ephemerides_of_usual_spacing_are_accepted(tmp_path: Path, spacing: float, count: int, accepted: bool) -> None:
    text = oem(segment(orbit_rows(spacing * np.arange(count))))
    epoch = labels(Time(NOON, scale="utc"), [spacing * ((count - 1) // 2 + 0.5)])[0]
    if accepted:
        assert start_of(tmp_path, text, epoch)["target_interpolation_error_m"] < 1.0
    else:
        assert f"about {instant(epoch).utc()}: interpolated with an error of" in refusal(tmp_path, text, epoch)


def test_two_rows_a_minute_apart_have_the_error_of_a_cubic_polynomial(tmp_path: Path) -> None:
    found = start_of(tmp_path, oem(segment(orbit_rows([0.0, 60.0]))), "2026-03-20T12:00:30")
    # By hand: R n^4 h^4 / 384.
    assert found["target_interpolation_error_m"] == pytest.approx(RADIUS_M * (RATE * 60.0) ** 4 / 384.0, rel=1e-3)
    off = np.linalg.norm(found["target_position_m"] - position(30.0)[0, :3])
    assert off == pytest.approx(found["target_interpolation_error_m"], rel=0.01)


@pytest.mark.parametrize(("first", "count"), [(0, 2), (-2, 4), (-2, 6)])
def test_no_state_is_interpolated_over_a_burn(tmp_path: Path, first: int, count: int) -> None:
    seconds = 60.0 * np.arange(first, first + count)
    states = position(seconds)
    # A burn of 1 m/s at 12:00:30, with what it moves the spacecraft by without gravity, to a millimetre.
    late = np.maximum(seconds - 30.0, 0.0)
    states[:, 2] += late
    states[:, 5] += late > 0.0
    rows = [row(label, state) for label, state in zip(labels(Time(NOON, scale="utc"), seconds), states, strict=True)]
    assert "a change of 1 m/s beside gravity from 2026-03-20T12:00:00" in refusal(
        tmp_path, oem(segment(rows)), "2026-03-20T12:00:20"
    )
    assert start_of(tmp_path, oem(segment(rows)), "2026-03-20T12:01:00")["target_object"] == "SAT"


def flown(spacing: float, burn: float, late: float, push: float) -> tuple[list[str], np.ndarray]:
    """Rows of an orbit over a flattened Earth, and positions (3, seconds) [m] between the two in the middle.

    A burn [m/s] is made some part of the spacing after the row before the middle. A push [m/s^2] turns twice in an
    orbit, as the attraction beyond the flattening does.
    """
    seconds, at_burn = spacing * np.arange(12), (5.0 + late) * spacing

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        r, distance = y[:3], np.linalg.norm(y[:3])
        flattening = 1.5 * 1.0826e-3 * (6378137.0 / distance) ** 2
        attraction = -MU / distance**3 * (1.0 + flattening * ([1.0, 1.0, 3.0] - 5.0 * (r[2] / distance) ** 2)) * r
        c, s = np.cos(2.0 * RATE * t), np.sin(2.0 * RATE * t)
        return np.concatenate([y[3:], attraction + push * np.array([c, s, -c])])

    def fly(state: np.ndarray, times: np.ndarray) -> np.ndarray:
        span = (times[0], times[-1])
        return np.asarray(solve_ivp(rates, span, state, "DOP853", times, rtol=1e-12, atol=1e-6).y)

    between = spacing * (5.0 + np.linspace(0.0, 1.0, 11))
    before, after = (np.concatenate([seconds, between]) <= at_burn), np.concatenate([seconds, between]) > at_burn
    times = np.concatenate([seconds, between])
    order = np.unique(np.append(times, at_burn))
    first = fly(position(0.0)[0], order[order <= at_burn])
    turned = first[:, -1] + burn * np.concatenate([np.zeros(3), first[3:, -1] / np.linalg.norm(first[3:, -1])])
    second = fly(turned, order[order >= at_burn])
    states = np.empty((len(times), 6))
    states[before] = first[:, np.searchsorted(order[order <= at_burn], times[before])].T
    states[after] = second[:, np.searchsorted(order[order >= at_burn], times[after])].T
    names = labels(Time(NOON, scale="utc"), seconds)
    return [row(*each) for each in zip(names, states[:12], strict=True)], states[12:, :3].T


@pytest.mark.parametrize(
    ("spacing", "burn"), [(180.0, 0.08), (240.0, 0.02), (240.0, 0.12), (300.0, 0.1), (400.0, 0.08), (500.0, 0.2)]
)
@pytest.mark.parametrize("late", [1e-5, 0.5])
def test_where_a_small_burn_is_interpolated_over_the_error_is_below_a_metre(
    tmp_path: Path, spacing: float, burn: float, late: float
) -> None:
    rows, between = flown(spacing, burn, late, 5e-5)
    refused = 0
    for number in range(1, 10):
        epoch = labels(Time(NOON, scale="utc"), [spacing * (5.0 + 0.1 * number)])[0]
        try:
            found = start_of(tmp_path, oem(segment(rows)), epoch)
        except ScenarioError as error:
            assert "beside gravity" in str(error) or "interpolated with an error" in str(error)
            refused += 1
        else:
            assert np.linalg.norm(found["target_position_m"] - between[:, number]) < 1.0
    assert refused == 9 or burn * spacing < 5.0


@pytest.mark.parametrize("spacing", [60.0, 240.0, 300.0])
def test_the_attraction_beyond_the_flattening_is_no_burn(tmp_path: Path, spacing: float) -> None:
    rows, between = flown(spacing, 0.0, 0.5, 5e-5)
    for number in range(1, 10):
        epoch = labels(Time(NOON, scale="utc"), [spacing * (5.0 + 0.1 * number)])[0]
        found = start_of(tmp_path, oem(segment(rows)), epoch)
        np.testing.assert_allclose(found["target_position_m"], between[:, number], rtol=0.0, atol=0.1)


MINUTES = 60.0 * np.arange(10)


def at_minute(number: float) -> str:
    return labels(Time(NOON, scale="utc"), [60.0 * number])[0]


def test_where_segments_meet_at_a_burn_the_later_one_is_the_start(tmp_path: Path) -> None:
    before, after = MINUTES, MINUTES + 540.0
    faster = [
        row(text, state * ([1] * 3 + [1.001] * 3))
        for text, state in zip(labels(Time(NOON, scale="utc"), after), position(after), strict=True)
    ]
    text = oem(segment(orbit_rows(before)), segment(faster))
    found = start_of(tmp_path, text, at_minute(9))
    np.testing.assert_allclose(found["target_velocity_m_s"], 1.001 * position(540.0)[0, 3:], rtol=0.0, atol=1e-6)
    for minute in (8.5, 0.0):
        found = start_of(tmp_path, text, at_minute(minute))
        np.testing.assert_allclose(found["target_velocity_m_s"], position(60.0 * minute)[0, 3:], rtol=0.0, atol=1e-6)
    assert "found '2 segments with states at 2026-03-20T12:08:30'" in refusal(
        tmp_path, oem(segment(orbit_rows(before)), segment(orbit_rows(after - 60.0))), at_minute(8.5)
    )


@pytest.mark.parametrize("minute", [9.5, 9.01, 12.0, 19.99])
def test_an_epoch_in_a_gap_is_refused_with_the_gap(tmp_path: Path, minute: float) -> None:
    text = oem(segment(orbit_rows(MINUTES)), segment(orbit_rows(MINUTES + 1200.0)))
    message = refusal(tmp_path, text, at_minute(minute))
    assert "found 'no states between 2026-03-20T12:09:00 and 2026-03-20T12:20:00'" in message
    assert instant(at_minute(minute)).utc() in message
    assert "found 'states from 2026-03-20T12:00:00 to 2026-03-20T12:29:00'" in refusal(tmp_path, text, at_minute(30))


@pytest.mark.parametrize("minute", [0.0, 3.99, 6.01, 9.0])
def test_states_are_used_in_the_useable_span_alone(tmp_path: Path, minute: float) -> None:
    span = "USEABLE_START_TIME = 2026-079T12:04:00\nUSEABLE_STOP_TIME = 2026-03-20T12:06:00Z\n"
    text = oem(segment(orbit_rows(MINUTES), span))
    assert "states from 2026-03-20T12:04:00 to 2026-03-20T12:06:00" in refusal(tmp_path, text, at_minute(minute))
    assert start_of(tmp_path, text)["epoch_utc"] == "2026-03-20T12:04:00"
    # States before the span serve the interpolation in it, as the standard means them to.
    found = start_of(tmp_path, text, at_minute(4.5))
    assert found["target_interpolation_error_m"] < 1e-5
    beyond = oem(segment(orbit_rows(MINUTES), span.replace("12:0", "18:0")))
    assert "USEABLE_START_TIME" in refusal(tmp_path, beyond)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"OBJECT_NAME = SAT": "OBJECT_NAME = OTHER"}, "2 objects: OTHER (2020-001A), SAT (2020-001A)"),
        ({"2020-001A": "2020-001B"}, "2 objects: SAT (2020-001A), SAT (2020-001B)"),
        ({"OBJECT_ID = 2020-001A\n": ""}, "2 objects"),
    ],
)
def test_an_ephemeris_of_two_objects_is_refused(tmp_path: Path, changes: dict[str, str], expected: str) -> None:
    other = METADATA
    for old, new in changes.items():
        other = other.replace(old, new)
    text = oem(segment(orbit_rows(MINUTES)), segment(orbit_rows(MINUTES + 600.0), metadata=other))
    assert expected in refusal(tmp_path, text)


@pytest.mark.parametrize("frame", ["TEME", "TOD", "GCRF", "EME2000"])
def test_a_frame_of_date_is_that_of_its_epoch(tmp_path: Path, frame: str) -> None:
    for text in (OPM, OEM):
        in_frame = text.replace("REF_FRAME = EME2000", f"REF_FRAME = {frame}\nREF_FRAME_EPOCH = 2000-001T12:00:00")
        R = inertial_frames.to_inertial(frame, instant("2000-01-01T12:00:00"), "")
        expected = R @ np.array(start_of(tmp_path, text)["target_position_m"])
        np.testing.assert_allclose(start_of(tmp_path, in_frame)["target_position_m"], expected, rtol=0.0, atol=1e-6)
    if frame == "TOD":
        # Nutation at J2000: the true equator is within 20 arc seconds of the mean one, far from that of 2026.
        assert np.allclose(inertial_frames.to_inertial(frame, instant("2000-01-01T12:00:00"), ""), np.eye(3), atol=1e-4)


def test_an_opm_is_a_start_at_its_epoch_alone(tmp_path: Path) -> None:
    found = start_of(tmp_path, OPM)
    assert (found["target_format"], found["target_object"], found["epoch_utc"]) == ("OPM", "SAT", NOON)
    np.testing.assert_allclose(found["target_position_m"], [6_878_137.0, 0.0, 0.0])
    assert start_of(tmp_path, OPM, "2026-03-20T14:00:00+02:00")["epoch_utc"] == NOON
    assert "an OPM with the state at 2026-03-20T12:00:00 alone" in refusal(tmp_path, OPM, "2026-03-20T12:00:01")


FIRST, SECOND = (with_checksum(line) for line in LINES)


def edited(number: int, column: int, text: str) -> str:
    """The element set with a text from a column (from 1) of a line on, and the checksum right."""
    lines = [FIRST, SECOND]
    line = lines[number - 1]
    lines[number - 1] = with_checksum(line[: column - 1] + text + line[column - 1 + len(text) :])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (edited(1, 63, "4"), "ephemeris type 4 (column 63)"),
        (edited(1, 63, "2"), "ephemeris type 2"),
        (edited(1, 63, "X"), "ephemeris type X"),
        (edited(1, 3, "25545"), "objects 25545 and 25544"),
        (edited(2, 3, "25545"), "objects 25544 and 25545"),
        (edited(2, 27, "000.317"), "2 ... "),
        (edited(2, 27, "00O6317"), "2 ... "),
        (edited(2, 10, " 51.64"), "2 ... "),
        (edited(1, 24, ","), "1 ... "),
        (edited(1, 60, "x"), "1 ... "),
        (edited(1, 21, "400"), "epoch 26400"),
        (edited(1, 19, "62"), "since 1972"),
        (edited(1, 8, "8"), "1 ... "),
        (f"{SECOND}\n{FIRST}\n", "line 1 and line 2"),
        (f"{FIRST}\n{FIRST}\n", "line 1 and line 2"),
        (f"{FIRST}\n", "1 element lines"),
        (f"{FIRST}\n{SECOND}\n{FIRST}\n{SECOND}\n", "4 element lines"),
        (f"A\nB\n{FIRST}\n{SECOND}\n", "4 lines"),
        (f"{FIRST}\n{SECOND}\nSAT\n", "a line before with its name"),
        (f"{FIRST}\nSAT\n{SECOND}\n", "a line before with its name"),
        (f"{FIRST[:-1]}{(int(FIRST[-1]) + 1) % 10}\n{SECOND}\n", "with its checksum"),
        (f"{FIRST[:-1]}\n{SECOND}\n", "an element line of 69"),
        (f"{FIRST}0\n{SECOND}\n", "an element line of 69"),
    ],
)
def test_element_lines_that_mean_something_else_are_refused(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refusal(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        edited(1, 8, "C"),
        edited(1, 8, "S"),
        edited(1, 8, " "),
        edited(1, 63, " "),
        edited(1, 10, 8 * " "),
        edited(1, 65, "    "),
        edited(2, 64, "99999"),
        "ISS (ZARYA)\n" + TLE,
        "0 ISS (ZARYA)\r\n" + TLE.replace("\n", "\r\n"),
        "\n" + TLE + "\n\n",
        edited(1, 3, "T5544").replace("2 25544", "2 T5544"),
    ],
)
def test_columns_that_are_numbers_of_a_catalogue_change_nothing(tmp_path: Path, text: str) -> None:
    lines = [with_checksum(line.rstrip()) if line[:2] in ("1 ", "2 ") else line for line in text.splitlines()]
    found = start_of(tmp_path, "\n".join(lines))
    assert found["target_position_m"] == start_of(tmp_path, TLE)["target_position_m"]
    assert found["epoch_utc"] == "2026-03-20T14:46:00.000192"
