"""Starts from two-line elements, OMM and OEM: against sgp4's own test cases, published frames and the oem library."""

import datetime
import json
import math
import re
import warnings
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import sgp4
from element_sets import TLE, with_checksum
from sgp4.api import Satrec

import rpojax
from rpojax.campaign import single_run
from rpojax.core.orbits import keplerian_elements
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.errors import Notice, ScenarioError
from rpojax.interop import ccsds_messages
from rpojax.interop.spacecraft_states import SpacecraftStates
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.starts import inertial_frames, orbit_states
from rpojax.scenario.loading.starts.orbit_states import OrbitState
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.time_scales import instant

MILLIMETRE = 1e-3
PUBLISHED = Path(sgp4.__file__).parent
REMOVED = '[[dispersions]]\nkey = "orbit.true_anomaly_deg"\nkind = "none"\n'


OMM = """CCSDS_OMM_VERS = 2.0
CREATION_DATE = 2026-03-20T00:00:00
ORIGINATOR = SOMEBODY
OBJECT_NAME = ISS
OBJECT_ID = 1998-067A
CENTER_NAME = EARTH
REF_FRAME = TEME
TIME_SYSTEM = UTC
MEAN_ELEMENT_THEORY = SGP4
EPOCH = 2026-03-20T14:46:00.000192
MEAN_MOTION = 15.49560000 [rev/day]
ECCENTRICITY = 0.0006317
INCLINATION = 51.6400
RA_OF_ASC_NODE = 208.9163
ARG_OF_PERICENTER = 69.9862
MEAN_ANOMALY = 25.2906
BSTAR = 0.0001027
MEAN_MOTION_DOT = 0.00016717
MEAN_MOTION_DDOT = 0.0
"""


def write_scenario(folder: Path, start: str, rest: str = REMOVED) -> Path:
    """A scenario that extends `inspection` with a section `start`."""
    path = folder / "mine.toml"
    path.write_text(f'extends = "inspection"\nname = "mine"\n[start]\n{start}\n{rest}')
    return path


def initial_target(file: Any) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of the target with which a run of the scenario begins."""
    truth = single_run.initialise_run(rpojax_without_dispersions(file), 0, 0)[2].truth
    return np.asarray(truth.r_TN_N), np.asarray(truth.v_TN_N)


def rpojax_without_dispersions(file: Any) -> Any:
    return scenario_loader.validate(file.model_dump() | {"dispersions": []})


def by_sgp4(lines: str, epoch: str) -> tuple[np.ndarray, np.ndarray]:
    """State of elements in TEME by sgp4 itself [m, m/s]."""
    from sgp4.api import jday

    moment = datetime.datetime.fromisoformat(epoch)
    seconds = moment.second + moment.microsecond * 1e-6
    day = jday(moment.year, moment.month, moment.day, moment.hour, moment.minute, seconds)
    _, position, velocity = Satrec.twoline2rv(*lines.strip().splitlines()[-2:]).sgp4(*day)
    return 1e3 * np.array(position), 1e3 * np.array(velocity)


def test_a_start_from_two_line_elements_agrees_with_sgp4_to_a_millimetre(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text("ISS (ZARYA)\n" + TLE)
    file = rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"'))
    assert file.start is not None
    found = (file.start.target_format, file.start.target_frame, file.start.target_object)
    assert found == ("TLE", "TEME", "ISS (ZARYA)")
    assert file.epoch_utc == "2026-03-20T14:46:00.000192"
    position, velocity = by_sgp4(TLE, file.epoch_utc)
    R = inertial_frames.to_inertial("TEME", instant(file.epoch_utc), "")
    r, v = initial_target(file)
    np.testing.assert_allclose(r, R @ position, rtol=0.0, atol=MILLIMETRE)
    np.testing.assert_allclose(v, R @ velocity, rtol=0.0, atol=1e-6)


def test_an_omm_of_the_same_elements_is_the_same_start(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    (tmp_path / "iss.omm").write_text(OMM)
    pairs = dict(line.split(" = ") for line in OMM.splitlines()[3:])
    body = "".join(f"<{name}>{value.split(' [')[0]}</{name}>" for name, value in pairs.items())
    (tmp_path / "iss.xml").write_text(
        f'<?xml version="1.0"?><ndm><omm><body><segment>{body}</segment></body></omm></ndm>'
    )
    states = [
        initial_target(rpojax.load(write_scenario(tmp_path, f'target = "iss.{kind}"')))
        for kind in ("tle", "omm", "xml")
    ]
    for r, v in states[1:]:
        np.testing.assert_allclose(r, states[0][0], rtol=0.0, atol=MILLIMETRE)
        np.testing.assert_allclose(v, states[0][1], rtol=0.0, atol=1e-6)


def test_an_epoch_of_ones_own_is_where_the_elements_are_propagated_to(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    file = rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"\nepoch_utc = "2026-03-20T18:00:00"'))
    position, _ = by_sgp4(TLE, "2026-03-20T18:00:00")
    R = inertial_frames.to_inertial("TEME", instant("2026-03-20T18:00:00"), "")
    # sgp4's Julian day has a resolution of some 20 us, in which the orbit advances by decimetres of a millimetre.
    np.testing.assert_allclose(initial_target(file)[0], R @ position, rtol=0.0, atol=MILLIMETRE)


def published_cases() -> list[tuple[str, list[float]]]:
    """Element sets of sgp4's verification file, and their states at their epochs in its published output."""
    text = (PUBLISHED / "SGP4-VER.TLE").read_text().splitlines()
    lines = [line for line in text if line[:2] in ("1 ", "2 ")]
    expected: dict[str, list[list[float]]] = {}
    number = ""
    for line in (PUBLISHED / "tcppver.out").read_text().splitlines():
        if line.rstrip().endswith("xx"):
            number = line.split()[0]
        elif number and float(line.split()[0]) == 0.0:
            expected.setdefault(number, []).append([float(word) for word in line.split()[1:7]])
    pairs = zip(lines[::2], lines[1::2], strict=True)
    sets = [(f"{first[:69]}\n{second[:69]}\n", first[2:7].lstrip("0")) for first, second in pairs]
    return [(pair, expected[number].pop(0)) for pair, number in sets if expected.get(number)]


def test_the_published_cases_of_sgp4_are_reproduced_at_their_epochs(tmp_path: Path) -> None:
    from rpojax.scenario.loading.starts import mean_elements

    cases, compared = published_cases(), 0
    for text, expected in cases:
        fixed = "\n".join(with_checksum(line) for line in text.splitlines())
        try:
            state = mean_elements.from_two_lines(fixed, None, "start.target")
        except ScenarioError as refused:
            assert "of SGP4" in str(refused)
            continue
        R = inertial_frames.to_inertial("TEME", state.epoch, "")
        np.testing.assert_allclose(R.T @ state.position_m, 1e3 * np.array(expected[:3]), rtol=0.0, atol=MILLIMETRE)
        np.testing.assert_allclose(R.T @ state.velocity_m_s, 1e3 * np.array(expected[3:]), rtol=0.0, atol=1e-5)
        compared += 1
    assert compared > 20


def test_teme_is_turned_as_published() -> None:
    # Vallado, Crawford, Hujsak and Kelso, Revisiting Spacetrack Report #3, AIAA 2006-6753, appendix C.
    epoch = instant("2004-04-06T07:51:28.386009")
    teme = np.array([5094.18016210, 6127.64465950, 6380.34453270])
    expected = [5102.50960000, 6123.01152000, 6378.13630000]
    np.testing.assert_allclose(inertial_frames.to_inertial("TEME", epoch, "") @ teme, expected, rtol=0.0, atol=5e-6)


def test_the_celestial_frame_differs_by_its_published_bias() -> None:
    # IERS Conventions 2010, section 5.3: offsets of the pole -16.617 and -6.819 mas, and of the equinox -14.6 mas.
    R = inertial_frames.to_inertial("GCRF", instant("2026-01-01"), "")
    mas = math.radians(1.0 / 3600e3)
    np.testing.assert_allclose(
        [R[0, 1], R[2, 0], R[2, 1]], np.array([-14.6, -16.617, -6.819]) * [1, 1, 1] * mas, atol=0.1 * mas
    )


@pytest.mark.parametrize(
    ("elements"),
    [
        (7.0e6, 0.001, 97.4, 77.0, 90.0, 10.0),
        (7.0e6, 0.0, 51.6, 200.0, 0.0, 33.0),
        (4.2e7, 0.3, 0.0, 0.0, 40.0, 300.0),
        (4.2e7, 0.0, 0.0, 0.0, 0.0, 100.0),
        (2.6e7, 0.74, 63.4, 350.0, 270.0, 181.0),
        (7.0e6, 0.01, 180.0, 0.0, 20.0, 30.0),
    ],
)
def test_elements_give_back_the_state(elements: tuple[float, ...]) -> None:
    size, eccentricity, *angles = elements
    names = ("inclination", "raan", "argument_of_perigee", "true_anomaly")
    of_angles = {name: jnp.deg2rad(angle) for name, angle in zip(names, angles, strict=True)}
    r, v = keplerian_elements.state_from_elements(
        KeplerianElements(semi_major_axis=jnp.array(size), eccentricity=jnp.array(eccentricity), **of_angles)
    )
    state = OrbitState(instant("2026-01-01"), np.asarray(r), np.asarray(v), "OEM", "EME2000", "")
    found = orbit_states.orbit_section(state)
    again = keplerian_elements.state_from_elements(
        KeplerianElements(
            semi_major_axis=jnp.array(found["semi_major_axis_m"]),
            eccentricity=jnp.array(found["eccentricity"]),
            **{name: jnp.deg2rad(found[f"{name}_deg"]) for name in names},
        )
    )
    np.testing.assert_allclose(again[0], r, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(again[1], v, rtol=0.0, atol=1e-8)


def oem_of(spacecraft: Any, position: np.ndarray, velocity: np.ndarray, times: np.ndarray) -> str:
    epoch = instant("2026-03-20T14:46:00")
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1))
    states = SpacecraftStates(spacecraft, epoch, times, position, velocity, attitude, ("By hand",))
    return ccsds_messages.oem(states, datetime.datetime(2026, 1, 1))


def circular(times: np.ndarray, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of an equatorial circle of 7000 km."""
    rate = math.sqrt(3.986004418e14 / 7e6**3)
    angle = rate * times + phase
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return 7e6 * np.stack([cosine, sine, zero], 1), 7e6 * rate * np.stack([-sine, cosine, zero], 1)


@pytest.mark.parametrize("seconds", [0.0, 60.0, 61.7, 299.0])
def test_an_oem_of_both_gives_the_orbit_and_the_relative_state(tmp_path: Path, seconds: float) -> None:
    times = np.arange(0.0, 301.0, 20.0)
    target, servicer = circular(times, 0.0), circular(times, -50.0 / 7e6)
    (tmp_path / "t.oem").write_text(oem_of("target", *target, times))
    (tmp_path / "s.oem").write_text(oem_of("servicer", *servicer, times))
    moment = datetime.datetime(2026, 3, 20, 14, 46) + datetime.timedelta(seconds=seconds)
    start = f'target = "t.oem"\nservicer = "s.oem"\nepoch_utc = "{moment.isoformat()}"'
    file = rpojax.load(write_scenario(tmp_path, start))
    r, v = circular(np.array([seconds]), 0.0)
    found = initial_target(file)
    np.testing.assert_allclose(found[0], r[0], rtol=0.0, atol=MILLIMETRE)
    np.testing.assert_allclose(found[1], v[0], rtol=0.0, atol=1e-6)
    # A chord of 50 m of arc behind: along the track, and by its bend towards the Earth. At rest in the turning frame.
    np.testing.assert_allclose(file.initial.relative_position_m, [-(50.0**2) / 1.4e7, -50.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(file.initial.relative_velocity_m_s, 0.0, atol=1e-6)


def test_a_run_begins_where_the_opm_that_was_exported_says(tmp_path: Path) -> None:
    epoch, times = instant("2016-12-31T23:59:60.123456"), np.zeros(1)
    attitude = np.array([[1.0, 0.0, 0.0, 0.0]])
    for name, phase in (("target", 0.3), ("servicer", 0.3 - 50.0 / 7e6)):
        states = SpacecraftStates(name, epoch, times, *circular(times, phase), attitude, ("By hand",))
        (tmp_path / f"{name}.opm").write_text(ccsds_messages.opm(states, datetime.datetime(2026, 1, 1)))
    file = rpojax.load(write_scenario(tmp_path, 'target = "target.opm"\nservicer = "servicer.opm"'))
    assert file.epoch_utc == "2016-12-31T23:59:60.123456"
    # A message has positions to 1e-6 m and velocities to 1e-9 m/s.
    truth = single_run.initialise_run(rpojax_without_dispersions(file), 0, 0)[2].truth
    r, v = circular(times, 0.3 - 50.0 / 7e6)
    np.testing.assert_allclose(truth.r_TN_N, circular(times, 0.3)[0][0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(truth.r_TN_N + truth.r_ST_N, r[0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(truth.v_TN_N + truth.v_ST_N, v[0], rtol=0.0, atol=2e-9)


@pytest.mark.parametrize(
    ("rest", "key"),
    [
        ("[orbit]\ninclination_deg = 97.0\n", "orbit"),
        ("[initial]\nrelative_position_m = [0.0, -300.0, 0.0]\n", "initial.relative_position_m"),
        ("[initial]\nrelative_velocity_m_s = [0.0, 0.0, 0.0]\n", "initial.relative_velocity_m_s"),
        ("epoch_utc = 2020-01-01T00:00:00\n", "epoch_utc"),
    ],
)
def test_what_a_start_would_replace_is_not_set_beside_it(tmp_path: Path, rest: str, key: str) -> None:
    times = np.zeros(1)
    for name, phase in (("t", 0.3), ("s", 0.3 - 50.0 / 7e6)):
        (tmp_path / f"{name}.oem").write_text(oem_of(name, *circular(times, phase), times))
    first = f'extends = "inspection"\nname = "mine"\n{rest if rest[0] != "[" else ""}'
    start = '[start]\ntarget = "t.oem"\nservicer = "s.oem"\n'
    together = tmp_path / "together.toml"
    together.write_text(f"{first}{start}{rest if rest[0] == '[' else ''}{REMOVED}")
    (tmp_path / "base.toml").write_text(f'extends = "inspection"\nname = "base"\n{start}{REMOVED}')
    above = tmp_path / "above.toml"
    above.write_text(f'extends = "base.toml"\nname = "mine"\n{rest}')
    assert rpojax.load(tmp_path / "base.toml").start is not None
    for path in (together, above):
        with pytest.raises(ScenarioError, match=f"^{key}: found .* beside start"):
            rpojax.load(path)


def test_an_override_of_a_start_is_refused(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    path = write_scenario(tmp_path, 'target = "iss.tle"')
    with pytest.raises(
        ScenarioError, match=r"found 'start.target=other.tle', expected start in the scenario file, which"
    ):
        scenario_loader.load(path, ["start.target=other.tle"])


@pytest.mark.parametrize("who", ["target", "servicer"])
def test_mean_elements_are_no_relative_state(tmp_path: Path, who: str) -> None:
    (tmp_path / "e.tle").write_text(TLE)
    times = np.zeros(1)
    (tmp_path / "o.oem").write_text(oem_of("o", *circular(times, 0.3), times))
    files = {"target": "o.oem", "servicer": "o.oem", who: "e.tle"}
    lines = [f'{name} = "{file}"' for name, file in files.items()]
    start = "\n".join([*lines, "epoch_utc = 2026-03-20T14:46:00"])
    with pytest.raises(ScenarioError, match=f"^start.{who}: found 'TLE beside a file of the"):
        rpojax.load(write_scenario(tmp_path, start))


def test_two_states_of_one_object_are_noticed(tmp_path: Path) -> None:
    times = np.zeros(1)
    for name, phase in (("t", 0.3), ("s", 0.3 - 50.0 / 7e6)):
        (tmp_path / f"{name}.oem").write_text(oem_of("the same", *circular(times, phase), times))
    with pytest.warns(Notice, match="THE SAME is the name of the target, too"):
        rpojax.load(write_scenario(tmp_path, 'target = "t.oem"\nservicer = "s.oem"'))


def test_a_recorded_start_whose_file_has_changed_says_so(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    file = rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"'))
    assert file.start is not None
    kept = file.start.model_dump(mode="json", exclude_none=True)
    record = "\n".join(f"{key} = {json.dumps(value)}" for key, value in kept.items())
    path = write_scenario(tmp_path, record)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rpojax.load(path)
    (tmp_path / "iss.tle").write_text(f"0 ISS\n{TLE}")
    with pytest.warns(Notice, match="iss.tle is not the file of target_sha256"):
        rpojax.load(path)


def test_the_record_of_a_start_is_not_read_again_and_changes_no_hash(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    file = rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"'))
    (tmp_path / "iss.tle").unlink()
    tables = file.model_dump(mode="json")
    assert scenario_loader.validate(tables) == file
    bare = {key: value for key, value in tables.items() if key != "start"}
    assert scenario_digest(scenario_loader.validate(bare)) == scenario_digest(file)


def test_a_dispersion_that_replaces_the_orbit_that_was_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(TLE)
    with pytest.raises(ScenarioError, match=r"orbit\.true_anomaly_deg"):
        rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"', rest=""))


EMPTY_OEM = """CCSDS_OEM_VERS = 2.0
META_START
OBJECT_NAME = A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
META_STOP
"""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "an OEM, OMM or OPM"),
        ("1 25544U\n2 25544\n", "an element line of 69"),
        (TLE.replace("51.6400", "51.6401"), "with its checksum"),
        (TLE + TLE, "line 1 and line 2 of one object"),
        (OMM.replace("REF_FRAME = TEME", "REF_FRAME = GCRF"), "REF_FRAME = GCRF"),
        (OMM.replace("BSTAR", "BSTAT"), "line 17: found 'BSTAT', expected a keyword of the OMM"),
        (OMM.replace("BSTAR", "COMMENT"), "no BSTAR"),
        (OMM.replace("0.0006317", "nan"), "ECCENTRICITY = nan', expected a finite number"),
        (OMM.replace("0.0006317", "1.7"), "eccentricity 1.7"),
        (OMM.replace("SGP4", "DSST"), "MEAN_ELEMENT_THEORY = DSST"),
        (EMPTY_OEM, "no states"),
        (EMPTY_OEM + "2026-03-20T00:00:00 1 2 3 4 5\n", "line 8: found .* a time and six numbers"),
        (EMPTY_OEM + "2026-03-20T00:00:00 1 2 3 4 5 inf\n", "a time and six numbers"),
        (EMPTY_OEM.replace("EARTH", "MARS") + "2026-03-20T00:00:00 1 2 3 4 5 6\n", "CENTER_NAME = MARS"),
        (EMPTY_OEM.replace("UTC", "UT1") + "2026-03-20T00:00:00 1 2 3 4 5 6\n", "TIME_SYSTEM = UT1"),
        (EMPTY_OEM + "2026-03-20T00:00:00 1 2 3 4 5 6\n" * 2, "increasing times"),
        (EMPTY_OEM.replace("EME2000", "ITRF") + "2026-03-20T00:00:00 7000 0 0 0 7 0\n", "the frame ITRF"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><omm/>", "document type"),
        ("<omm>", "XML with"),
        ("<omm></omm>", "0 segments"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "start.txt").write_text(text)
    with pytest.raises(ScenarioError, match=expected) as refused:
        rpojax.load(write_scenario(tmp_path, 'target = "start.txt"'))
    assert str(refused.value).startswith("start.target")
    assert re.search(r"\n", str(refused.value)) is None


def test_a_missing_file_and_a_time_outside_of_the_message_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"start.target: found '.*none.oem \(no such file or directory\)'"):
        rpojax.load(write_scenario(tmp_path, 'target = "none.oem"'))
    times = np.arange(0.0, 100.0, 20.0)
    (tmp_path / "t.oem").write_text(oem_of("target", *circular(times, 0.0), times))
    with pytest.raises(ScenarioError, match="expected some about 2026-03-20T16:00:00"):
        rpojax.load(write_scenario(tmp_path, 'target = "t.oem"\nepoch_utc = "2026-03-20T16:00:00"'))
    (tmp_path / "iss.tle").write_text(TLE)
    with pytest.raises(ScenarioError, match="elements within 30 days of 2026-06-01"):
        rpojax.load(write_scenario(tmp_path, 'target = "iss.tle"\nepoch_utc = "2026-06-01T00:00:00"'))
