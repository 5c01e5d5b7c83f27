"""Metrics, traces, outcomes and the report take each run's own values, not the nominal ones of the scenario."""

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rpojax
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.report.sections import safety_section
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.judgement import LIMIT_KEYS
from rpojax.value_types import Section

PACKAGE = Path(rpojax.__file__).parent
LAST_DIGITS = 1e-9
SINGLE = 1e-6
"""Relative error of records and traces in single precision."""

OWN_VALUES = {
    "formation.desired_position_m": [[0.0, -20.0, 0.0], [0.0, -45.0, 0.0], [3.0, -50.0, 4.0], [0.0, -30.0, -8.0]],
    "pointing.settle_time_s": [0.0, 5.0, 30.0, 12.0],
    "limits.keep_out_m": [10.0, 60.0, 20.0, 5.0],
    "limits.lost_after_s": [600.0, 40.0, 2.0, 600.0],
    "limits.off_station_m": [1.0, 40.0, 50.0, 60.0],
    "limits.arrive_by_s": [100.0, 3000.0, 10.0, 299.0],
    "limits.propellant_kg": [3.0, 3.0, 3.0, 1e-5],
    "camera.field_of_view_deg": [10.0, 8.0, 10.0, 12.0],
}
"""Every key that a metric, a trace, an outcome or a section of the report reads, with a value for each run."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Four runs of a table, all with a history, and their report."""
    file = scenario_loader.load("inspection", ["duration_s=300", "requirements=[]"])
    columns = {
        f"{key}[{i}]" if np.ndim(rows) == 2 else key: np.asarray(rows, dtype=float).reshape(4, -1)[:, i].tolist()
        for key, rows in OWN_VALUES.items()
        for i in range(np.asarray(rows).reshape(4, -1).shape[1])
    }
    table = scenario_loader.validate({**file.model_dump(), "design": {"kind": "table", "file": "", "values": columns}})
    folder = tmp_path_factory.mktemp("own") / "out"
    return run_campaign(table, 4, folder, seed=3, histories=range(4), progress=False)


def own(run: int, key: str) -> np.ndarray:
    """Value of a key in a run."""
    return np.asarray(OWN_VALUES[key][run], dtype=float)


def test_the_table_holds_every_key_that_is_read() -> None:
    read = {node.value for _, node in _constants() if "." in str(node.value)} & set(_dispersible_keys())
    assert {*read, *LIMIT_KEYS} == set(OWN_VALUES)


def test_nothing_reads_a_nominal_number_that_a_run_may_have_of_its_own() -> None:
    """Parameters (`params.…`) hold the run's own numbers, sections of a scenario the nominal ones."""
    found = []
    keys = _dispersible_keys()
    for path, tree in _modules():
        allowed = {id(node) for call in _calls(tree, "values_of_runs") for node in ast.walk(call)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute):
                chain = f"{node.value.attr}.{node.attr}"
                if chain in keys and id(node) not in allowed and not ast.unparse(node).startswith("params."):
                    found.append(f"{path.relative_to(PACKAGE)}: {chain}")
    assert found == []


def test_formation_error_is_about_the_desired_position_of_the_run(campaign: Campaign) -> None:
    traced = campaign.traces["formation_error_m"]
    for run in np.flatnonzero(campaign.reached_end).tolist():
        history, desired = campaign.history(run), own(run, "formation.desired_position_m")
        np.testing.assert_array_equal(history["rho_desired_H"], desired)
        error = np.linalg.norm(history["rho_H"].astype(float) - desired, axis=1)
        metric = np.sqrt(np.mean(error[200:] ** 2))
        np.testing.assert_allclose(campaign.metrics["formation_error_rms_m"][run], metric, rtol=LAST_DIGITS)
        np.testing.assert_allclose(traced[run], error[::10], rtol=SINGLE)


def test_pointing_error_counts_from_the_settling_time_of_the_run(campaign: Campaign) -> None:
    for run in np.flatnonzero(campaign.reached_end).tolist():
        history, settle = campaign.history(run), int(own(run, "pointing.settle_time_s"))
        looking = history["mode"] == 0
        settled = [bool(looking[max(0, tick - settle) : tick + 1].all()) for tick in range(300)]
        metric = np.percentile(history["pointing_error_deg"][settled], 95.0)
        np.testing.assert_allclose(campaign.metrics["pointing_error_p95_deg"][run], metric, rtol=SINGLE)


def test_outcomes_are_by_the_limits_of_the_run(campaign: Campaign) -> None:
    expected = [_outcome(campaign, run) for run in range(4)]
    assert campaign.outcomes.tolist() == expected
    assert expected == ["off_station", "keep_out", "completed", "out_of_propellant"]
    lost = [event for event in campaign.events if event.outcome == "lost"]
    assert {event.run_id for event in lost} >= {2}


def _outcome(campaign: Campaign, run: int) -> str:
    """Outcome by a loop over time."""
    history = campaign.history(run)
    if np.isnan(history["range_m"]).any():
        return "keep_out"
    unseen_s, last = 0, len(history["time_s"]) - 1
    for accepted, false, light in zip(
        history["box_accepted"], history["box_outlier"], history["observable"], strict=True
    ):
        unseen_s = 0 if accepted and not false else unseen_s + int(light)
    off = np.linalg.norm(history["rho_H"][last] - own(run, "formation.desired_position_m"))
    if history["propellant_used_kg"][last] >= own(run, "limits.propellant_kg"):
        return "out_of_propellant"
    if unseen_s >= own(run, "limits.lost_after_s"):
        return "lost"
    if last + 1 < own(run, "limits.arrive_by_s"):
        return "not_judged"
    return "off_station" if off > own(run, "limits.off_station_m") else "completed"


def test_the_safety_section_takes_the_keep_out_radius_of_the_run(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    safety = safety_section.content(campaign)
    assert safety["keep_out_m"] == [5.0, 60.0]
    assert safety["entries"]["run_ids"] == [1]
    drifts, drawn = campaign.metrics["passive_range_m"], campaign.drawn
    assert np.isnan(drifts).tolist() == [False, True, False, False]
    # Radii just below and just above the least range of each run's own drifts; run 1 has entered its sphere.
    for shift_m, count in ((-1e-3, 1), (1e-3, 4)):
        radii = np.where(np.isnan(drifts), 60.0, drifts + shift_m)
        changed = {**drawn, "limits.keep_out_m": radii}
        monkeypatch.setattr(Campaign, "drawn", property(lambda _, changed=changed: changed))
        assert safety_section.content(campaign)["passive_below_keep_out"]["count"] == count


def _dispersible_keys() -> set[str]:
    """All keys of numbers that may differ from run to run."""
    file = scenario_loader.load("inspection")
    return {
        f"{name}.{key}"
        for name in ScenarioFile.model_fields
        if isinstance(getattr(file, name), Section)
        for key in type(getattr(file, name)).model_fields
        if nominal_of_key(file, f"{name}.{key}") is not None
    }


def _modules() -> Iterator[tuple[Path, ast.Module]]:
    """Modules that evaluate, store or show runs."""
    for folder in ("simulation/metrics", "simulation/outcomes", "metrics", "report", "interop", "campaign"):
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def _constants() -> Iterator[tuple[Path, ast.Constant]]:
    """Texts in calls that ask for the values of runs."""
    for path, tree in _modules():
        for call in _calls(tree, "values_of_runs"):
            yield from ((path, node) for node in ast.walk(call) if isinstance(node, ast.Constant))


def _calls(tree: ast.Module, name: str) -> list[ast.Call]:
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
    ]
