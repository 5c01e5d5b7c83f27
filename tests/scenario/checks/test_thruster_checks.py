"""Tests of the checks of the reaction control system."""

import pytest

import rpojax
from rpojax.errors import ScenarioError
from rpojax.scenario.checks.thruster_checks import check_faults, check_thrusters
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import FaultSection
from tests.scenario_error_assertions import assert_one_line


@pytest.fixture(scope="module")
def file() -> ScenarioFile:
    return rpojax.load("final_approach")


def with_thrusters(file: ScenarioFile, **changes: object) -> ScenarioFile:
    """The scenario with changes of its first thruster."""
    first = file.thrusters[0].model_copy(update=changes)
    return file.model_copy(update={"thrusters": [first, *file.thrusters[1:]]})


def test_packaged_thrusters_pass(file: ScenarioFile) -> None:
    check_thrusters(file)


def test_thrusters_that_all_push_one_way_are_refused(file: ScenarioFile) -> None:
    one_way = [each.model_copy(update={"direction": [1.0, 0.0, 0.0]}) for each in file.thrusters]
    with pytest.raises(ScenarioError) as refused:
        check_thrusters(file.model_copy(update={"thrusters": one_way}))
    assert_one_line(refused.value, "thrusters", "to both sides")


def test_thrusters_through_the_centre_of_mass_give_no_torque(file: ScenarioFile) -> None:
    centred = [each.model_copy(update={"position_m": [0.0, 0.0, 0.0]}) for each in file.thrusters]
    with pytest.raises(ScenarioError) as refused:
        check_thrusters(file.model_copy(update={"thrusters": centred}))
    assert_one_line(refused.value, "thrusters", "torque about x")


def test_pulses_longer_than_half_a_step_are_refused(file: ScenarioFile) -> None:
    with pytest.raises(ScenarioError) as refused:
        check_thrusters(with_thrusters(file, minimum_on_s=0.15))
    assert_one_line(refused.value, "thrusters.t01.minimum_on_s", "half of a step")


def test_equal_names_are_refused(file: ScenarioFile) -> None:
    with pytest.raises(ScenarioError) as refused:
        check_thrusters(with_thrusters(file, name="t02"))
    assert_one_line(refused.value, "thrusters.name", "no other thruster")


def test_a_fault_of_no_thruster_is_refused(file: ScenarioFile) -> None:
    fault = FaultSection(name="valve", kind="thruster_off", thruster=12.0)
    with pytest.raises(ScenarioError) as refused:
        check_faults(file.model_copy(update={"faults": [fault]}))
    assert_one_line(refused.value, "faults.valve.thruster", "at most 11")


def test_continuous_control_needs_thrusters() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("vbar_approach", ['phases.hold_12.control="continuous"', "phases.hold_12.control_period_s=1.0"])
    assert_one_line(refused.value, "phases.hold_12.control", "[[thrusters]]")


def test_continuous_control_has_no_period_of_its_own() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("final_approach", ["phases.final.control_period_s=10.0"])
    assert_one_line(refused.value, "phases.final.control_period_s", "no period")


def test_a_number_of_one_thruster_is_set_by_its_name() -> None:
    file = rpojax.load("final_approach", ["thrusters.t03.force_n=0.2"])
    assert [each.force_n for each in file.thrusters].count(0.2) == 1


NO_FAULT = "faults.fault.kind=none"


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("thruster_stuck_open", "faults.fault.kind=thruster_stuck_open"),
        ("thruster_leak", "dispersions.faults.fault.kind={kind='choice', values=['gps_outage', 'thruster_leak']}"),
    ],
)
def test_the_one_thruster_neither_sticks_open_nor_leaks(kind: str, change: str) -> None:
    expected = rf"faults\.fault\.kind: found '{kind}', expected another kind, or \[\[thrusters\]\]"
    with pytest.raises(ScenarioError, match=expected):
        rpojax.load("inspection", ["effects.faults=true", NO_FAULT, change])
    rpojax.load("inspection", [NO_FAULT, change])
    rpojax.load("final_approach", ["effects.faults=true", NO_FAULT, change])


def test_isolation_valves_need_thrusters() -> None:
    with pytest.raises(ScenarioError, match=r"isolation\.enabled: found True, expected false, or \[\[thrusters\]\]"):
        rpojax.load("inspection", ["isolation.enabled=true"])


@pytest.mark.parametrize(
    "change", ["isolation.valve_s=-1", "isolation.pressure=0", "isolation.pressure=1", "isolation.samples=0"]
)
def test_numbers_of_isolation_have_bounds(change: str) -> None:
    key, _, value = change.partition("=")
    with pytest.raises(ScenarioError, match=rf"^{key}: found {float(value):g}"):
        rpojax.load("thruster_failure", [change])


def test_inertia_follows_the_propellant_only_with_the_centre_of_mass() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", ["effects.inertia_change=true", "effects.center_of_mass_shift=false"])
    assert_one_line(refused.value, "effects.inertia_change", "center_of_mass_shift")


@pytest.mark.parametrize("change", ["thruster.tank_position_m=[-0.9,0,0]", "thruster.tank_radius_m=0.9"])
def test_a_tank_outside_of_the_body_is_refused(change: str) -> None:
    both = ["effects.inertia_change=true", "effects.center_of_mass_shift=true"]
    assert rpojax.load("inspection", both).effects.inertia_change
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [*both, change])
    assert_one_line(refused.value, "thruster.tank_position_m", "within the body")
