"""Lists of faults that are refused, each in one line."""

import pytest

import rpojax
from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader

ON = "effects.faults=true"
REFUSED = {
    "an unknown kind": ("inspection", ["faults.a.kind=gremlin"], "faults.a.kind: found 'gremlin'"),
    "no kind": ("inspection", ["faults.a.start_s=5"], "faults.a.kind: missing"),
    "no duration": ("inspection", ["faults.a.kind=none", "faults.a.duration_s=0"], "faults.a.duration_s: found 0"),
    "a time before the run": ("inspection", ["faults.a.kind=gps_outage", "faults.a.start_s=-1"], "faults.a.start_s"),
    "no such wheel": ("inspection", ["faults.a.kind=wheel_stuck", "faults.a.wheel=3"], "faults.a.wheel: found 3"),
    "no such thruster": (
        "final_approach",
        [ON, "faults.a.kind=thruster_off", "faults.a.thruster=12"],
        "faults.a.thruster: found 12.0, expected at most 11",
    ),
    "a dispersed thruster that there is not": (
        "final_approach",
        [ON, "faults.a.kind=thruster_off", "dispersions.faults.a.thruster={kind='choice', values=[3, 12]}"],
        "faults.a.thruster: found 12.0",
    ),
    "too many": ("inspection", [f"faults.a{k}.kind=none" for k in range(9)], "'9 of them', expected at most 8"),
    "a former key": ("inspection", ["fault.kind=gps_outage"], "expected faults.NAME.kind, a key of one of the list"),
    "a former dispersion": (
        "inspection", ["dispersions.fault.start_s={kind='uniform', low=0, high=1}"], "expected faults.NAME.start_s"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_list_of_faults_is_refused_in_one_line(name: str) -> None:
    source, overrides, told = REFUSED[name]
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(source, overrides)
    assert told in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_equal_names_are_refused() -> None:
    tables = rpojax.load("inspection", ["faults.a.kind=none"]).model_dump()
    tables["faults"] *= 2
    with pytest.raises(ScenarioError, match=r"^faults.name: found 'a', expected a name that no other fault has"):
        scenario_loader.validate(tables)
