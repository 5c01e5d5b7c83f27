"""Impulses of transfers before flight are those that are flown, and warnings of times that two impulses do not fit."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references import transfer
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.phases.reference_sections import TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings import transfer_impulses
from rpojax.scenario.warnings.mission_warnings import mission_warnings

MU = 3.986004418e14
state_of = jax.jit(transfer.state)


def file_with(eccentricity: float = 0.0, **reference: Any) -> ScenarioFile:
    tables = scenario_loader.load("inspection").model_dump()
    semi_major_axis_m = tables["orbit"]["semi_major_axis_m"] / (1.0 - eccentricity)
    orbit = {"eccentricity": eccentricity, "semi_major_axis_m": semi_major_axis_m, "argument_of_perigee_deg": 50.0}
    section = {"kind": "transfer", "position_m": [0.0, -30.0, 0.0], "duration_s": 1600.0} | reference
    phase = {"name": "go", "reference": section}
    return scenario_loader.validate(tables | {"orbit": tables["orbit"] | orbit, "phases": [phase]})


def period(file: ScenarioFile) -> float:
    return float(2.0 * np.pi * np.sqrt(file.orbit.semi_major_axis_m**3 / MU))


def place(file: ScenarioFile, u: float) -> TargetOrbit:
    perigee, e = np.radians(file.orbit.argument_of_perigee_deg), file.orbit.eccentricity
    numbers = [u, e * np.cos(perigee), e * np.sin(perigee), file.orbit.semi_major_axis_m]
    return TargetOrbit(**dict(zip(TargetOrbit.__annotations__, map(jnp.float64, numbers), strict=True)))


@pytest.mark.parametrize("eccentricity", [0.0, 0.3])
@pytest.mark.parametrize(("pulses", "share"), [(2, 0.3), (5, 0.3), (2, 0.49), (2, 1.0), (3, 1.0), (2, 2.03)])
def test_impulses_are_those_of_the_reference(eccentricity: float, pulses: int, share: float) -> None:
    """At regular and at singular times; the way and every jump of the velocity on it."""
    start = np.array([4.0, -60.0, 3.0])
    duration = share * period(file_with(eccentricity))
    file = file_with(eccentricity, position_m=[0.0, -32.0, 0.0])
    given = file.phases[0].reference
    assert isinstance(given, TransferSection)
    section = given.model_copy(update={"duration_s": duration, "pulses": pulses, "speed_ratio": 0.4})
    u = 0.7
    [arcs] = zip(*transfer_impulses._flown_from(file, section, start, np.array([u])), strict=True)
    found = transfer_impulses._at_place(*arcs)
    numbers = {"position": [0.0, -32.0, 0.0], "duration": duration, "pulses": float(pulses), "speed_ratio": 0.4}
    reference = transfer.Transfer(**{name: jnp.asarray(value) for name, value in numbers.items()})
    entry = PhaseEntry(relative_state=jnp.array([*start, 0.0, 0.0, 0.0]), orbit=place(file, u))

    def state(time: float) -> np.ndarray:
        return np.asarray(state_of(reference, entry, entry.orbit, jnp.asarray(time)))

    count = len(found.way) // (pulses - 1)
    interval = duration / (pulses - 1)
    times = [arc * interval + interval * s for arc in range(pulses - 1) for s in np.linspace(0.0, 1.0, count)]
    shown = range(1, count - 1, 23)
    np.testing.assert_allclose(found.way[shown], [state(times[k])[:3] for k in shown], atol=1e-6)
    singular = len(found.impulses) > pulses
    assert singular == (share in (0.49, 1.0, 2.03))
    # Between the impulses the motion is free: the velocity jumps by them alone.
    total = float(np.sum(np.linalg.norm(found.impulses, axis=1)))
    fine = np.linspace(1e-6, duration - 1e-6, 4001)
    velocities = np.array([state(each)[3:] for each in fine[:: 4000 if not singular else 1]])
    np.testing.assert_allclose(found.impulses[0], velocities[0], atol=1e-7)
    np.testing.assert_allclose(found.impulses[-1], -velocities[-1], atol=1e-7)
    if singular and pulses == 2:
        jump = np.max(np.linalg.norm(np.diff(velocities, axis=0), axis=1))
        np.testing.assert_allclose(np.linalg.norm(found.impulses[1]), jump, rtol=0.1, atol=2e-4)
    assert total < 0.5


@pytest.mark.parametrize(
    ("share", "warned"),
    [
        *[(0.3, False), (0.42, False), (0.49, True), (0.55, True)],
        *[(0.75, False), (1.0, True), (1.2, False), (2.0, True)],
    ],
)
def test_times_near_half_turns_and_whole_ones_are_warned_of_with_regular_ones(share: float, warned: bool) -> None:
    seconds = share * period(file_with())
    file = file_with(position_m=[0.0, -32.0, 0.0], duration_s=seconds)
    lines = [each for each in mission_warnings(file) if "reference.duration_s" in each]
    assert bool(lines) is warned
    if warned:
        shorter, longer = transfer_impulses.nearest_regular(file, seconds)
        assert shorter is not None
        assert shorter < seconds < longer
        assert f"at most {int(shorter)} s or at least" in lines[0]
        for each in (shorter, longer):
            assert transfer_impulses.share_of_singular_places(file, each) == 0.0


def test_the_figure_is_what_a_metre_across_the_track_takes_near_half_an_orbit() -> None:
    """z(t) = z_dot sin(n t) / n: at 0.48 orbits the sine is that of 7.2 deg."""
    file = file_with()
    n = 2.0 * np.pi / period(file)
    expected = n / np.sin(np.radians(7.2))
    np.testing.assert_allclose(transfer_impulses.sensitivity(file, 0.48 * period(file)), expected, rtol=1e-6)


@pytest.mark.parametrize(("share", "warned"), [(0.2, False), (0.5, True)])
def test_burns_half_an_orbit_apart_are_warned_of(share: float, warned: bool) -> None:
    seconds = 20.0 * round(share * period(file_with()) / 20.0)
    tables = file_with().model_dump(exclude_none=True)
    tables["phases"][0]["control_period_s"] = seconds
    lines = [each for each in mission_warnings(scenario_loader.validate(tables)) if "control_period_s" in each]
    assert bool(lines) is warned


@pytest.mark.parametrize("eccentricity", [0.7, 0.85])
def test_on_an_elliptic_orbit_whole_periods_are_singular_and_there_are_regular_times(eccentricity: float) -> None:
    file = file_with(eccentricity)
    assert transfer_impulses.share_of_singular_places(file, period(file)) > 0.5
    shorter, longer = transfer_impulses.nearest_regular(file, period(file))
    assert shorter is not None
    assert longer < 2.0 * period(file)
