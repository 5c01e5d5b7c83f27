"""Every fault of a team is refused with one line."""

from collections.abc import Callable
from typing import Any

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError, UnknownKeyError
from rpojax.scenario.loading import scenario_loader

Tables = dict[str, Any]
SECOND = "servicers.second"
HEARS = "link.hears"
NEAR = [0.0, 50.0, 30.05]
FAR = [0.0, -50.0, -30.0]
HANDOVER = {"relative_position_m": [0.0, 90.0, 0.0], "handover": {"position_sigma_m": 1.0}}
LOSS = {"key": "link.loss", "kind": "uniform", "low": 0.0, "high": 0.5}


def _second(**changes: Any) -> Callable[[Tables], None]:
    return lambda tables: tables["servicers"][1].update(changes)


def _link(**changes: Any) -> Callable[[Tables], None]:
    return lambda tables: tables.update(link=changes)


def _team(**changes: Any) -> Callable[[Tables], None]:
    return lambda tables: tables.update(team=changes)


def _apart(**changes: Any) -> Callable[[Tables], None]:
    """Servicers that keep clear of each other, in a scenario with changes."""

    def change(tables: Tables) -> None:
        tables["team"] = {"keep_out_m": 10.0}
        tables["servicers"] = [{"name": "first"}, {"name": "second", "initial": {"relative_position_m": FAR}}]
        for key, value in changes.items():
            tables[key] = value if isinstance(value, list) else tables[key] | value

    return change


def _dispersion(**entry: Any) -> Callable[[Tables], None]:
    return lambda tables: tables["dispersions"].append({"kind": "normal", "sigma": 0.001} | entry)


def _many(tables: Tables) -> None:
    tables["servicers"] += [
        {"name": f"more_{k}", "initial": {"relative_position_m": [0.0, 100.0 + k, 0.0]}} for k in range(6)
    ]


def _alone(**changes: Any) -> Callable[[Tables], None]:
    def change(tables: Tables) -> None:
        tables["servicers"] = []
        tables["navigation"]["sharing"] = "none"
        for key, value in changes.items():
            tables[key] = value if isinstance(value, list) else tables[key] | value

    return change


FAULTS: list[tuple[Callable[[Tables], None], str, str]] = [
    (_second(initial={"relative_position_m": NEAR}), SECOND + ".initial.relative_position_m", "'first'"),
    (_second(initial={"relative_position_m": [0.0, 5.0, 0.0]}), SECOND + ".initial.relative_position_m", "keep_out_m"),
    (_second(initial={"relative_position_m": [0.0, 5.0]}), "servicers.1.initial.relative_position_m", "3"),
    (_second(name="first"), "servicers.name", "no other"),
    (_second(name="Second one"), "servicers.1.name", "pattern"),
    (_many, "servicers", "at most 8"),
    (_second(target={"mass_kg": 50.0}), "servicers.1.target", "one target for all"),
    (_second(duration_s=100.0), "servicers.1.duration_s", "one duration_s for all"),
    (_second(camera={"width_px": 256}), SECOND + ".camera.width_px", "128 as servicer 'first'"),
    (_second(camera={"model": "statistical"}), SECOND + ".camera.model", "'geometric'"),
    (_second(navigation={"sharing": "none"}), SECOND + ".navigation.sharing", "'boxes'"),
    (_second(gps={"common_share": 0.5}), SECOND + ".gps.common_share", "0.9 as servicer 'first'"),
    (_second(navigation={"difference_noise_m": 1.0}), SECOND + ".navigation.difference_noise_m", "2.83"),
    (_second(initial=HANDOVER), SECOND + ".initial.handover", "no value"),
    (_second(phases={"inspect": {"control_period_s": 180.0}}), SECOND + ".phases.inspect.control_period_s", "no value"),
    (_second(phases={"inspect": {"passively_safe": False}}), SECOND + ".phases.inspect.passively_safe", "True"),
    (_second(phases={"inspct": {"timeout_s": 1.0}}), SECOND + ".phases", "did you mean 'inspect'"),
    (_second(phases={"inspect": {"reference": {"radial_m": -1.0}}}), f"{SECOND}.phases.inspect.reference.radial_m", ""),
    (_second(decision_offset_s=30.0), SECOND + ".decision_offset_s", "20 s"),
    (_second(decision_offset_s=200.0), SECOND + ".decision_offset_s", "below 200 s"),
    (_link(period_s=1.5), "link.period_s", "camera periods"),
    (_link(period_s=0.001), "link.period_s", "camera periods"),
    (_link(delay_s=0.5), "link.delay_s", "camera periods"),
    (_link(outages_s=[[20.0, 10.0]]), "link", "end after they start"),
    (_link(hears=[["first", "fourth"]]), HEARS, "first, second, third"),
    (_link(hears=[["first", "first"]]), HEARS, "two servicers"),
    (_link(hears=[["first", "second"], ["second", "first"]]), HEARS, "navigation.sharing = 'none'"),
    (_link(hears=[]), HEARS, "navigation.sharing = 'none'"),
    (lambda tables: tables.update(servicers=[{"name": "only"}]), HEARS, "links to each servicer"),
    (_alone(navigation={"sharing": "boxes"}), "navigation.sharing", "[[servicers]]"),
    (_alone(link={"loss": 0.1}), "link", "them only in a scenario with [[servicers]]"),
    (_alone(team={"keep_out_m": 10.0}), "team", "[[servicers]]"),
    (_team(keep_out_m=70.0), "servicers.third.initial.relative_position_m", "than team.keep_out_m = 70"),
    (_team(keep_out_m=-1.0), "team.keep_out_m", "0"),
    (_apart(navigation={"sharing": "none"}), "team.keep_out_m", "navigation.sharing beside it"),
    (_apart(phases=[]), "team.keep_out_m", "phases beside it"),
    (_team(phasing="evenly"), "team.phasing", "'fixed', 'spread' or 'viewpoints'"),
    (_apart(team={"phasing": "spread", "keep_out_m": 0.0}, navigation={"sharing": "none"}), "team.phasing", "sharing"),
    (_apart(team={"phasing": "spread", "keep_out_m": 0.0}, phases=[]), "team.phasing", "phases beside it"),
    (_dispersion(key="team.keep_out_m"), "team.keep_out_m", "above 0, as it is dispersed"),
    (_alone(gps_differences={"kind": "carrier"}), "gps_differences", "[[servicers]]"),
    (_alone(link_range={"enabled": True}), "link_range", "[[servicers]]"),
    (_alone(dispersions=[LOSS]), "dispersions", "[[servicers]]"),
    (_dispersion(key="orbit.raan_deg", common=False), "dispersions.10.common", "orbit.raan_deg in common"),
    (_dispersion(key="link.period_s"), "dispersions.10.key", "key of a number"),
    (lambda tables: tables.update(design={"kind": "sobol"}), "design.kind", "on its own"),
]  # fmt: skip


@pytest.mark.parametrize(("spoil", "key", "expected"), FAULTS)
def test_a_fault_of_a_team_is_refused_with_one_line(
    tables: Tables, spoil: Callable[[Tables], None], key: str, expected: str
) -> None:
    scenario_loader.validate(tables)
    spoil(tables)
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, key, expected)
    assert caught.value.key == key


def test_an_unknown_key_of_a_servicer_is_named(tables: Tables) -> None:
    tables["servicers"][1]["camera"] = {"width": 256}
    with pytest.raises(UnknownKeyError, match=r"^servicers.1.camera.width: unknown key \(did you mean 'width_px'\?\)$"):
        scenario_loader.validate(tables)
    tables["servicers"][1] = {"name": "second", "camara": {}}
    with pytest.raises(UnknownKeyError, match=r"^servicers.1.camara: unknown key \(did you mean 'camera'\?\)$"):
        scenario_loader.validate(tables)


def test_a_value_that_a_dispersion_replaces_is_refused(tables: Tables) -> None:
    tables["dispersions"].append({"key": "faults.camera.kind", "kind": "choice", "values": ["none", "gps_outage"]})
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, SECOND + ".faults.camera.kind", "the choice dispersion")


def test_a_joint_or_derived_dispersion_does_not_mix_what_is_common_with_what_is_not(tables: Tables) -> None:
    joint: Tables = {"keys": ["orbit.raan_deg", "gps.noise_m"], "kind": "correlated_normal"}
    joint["covariance"] = [[1e-4, 0.0], [0.0, 1e-4]]
    tables["dispersions"].append(joint)
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, "dispersions.10.common", "true", "gps.noise_m")
    joint["common"] = True
    scenario_loader.validate(tables)
    tables["dispersions"][-1] = {
        "key": "orbit.raan_deg", "kind": "derived", "offset": 0.0, "terms": [{"key": "gps.noise_m", "factor": 1.0}],
    }  # fmt: skip
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, "dispersions.10.terms", "in common")
