"""Dispersions that are refused."""

from typing import Any

import pytest
from scenario_error_assertions import assert_one_line
from scenario_variants import correlated, derived, with_sections

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the nominal scenario with a fault, free to be changed."""
    return inspection_file.model_dump() | {"faults": [{"name": "fault", "kind": "none"}]}


BAD_DISPERSIONS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "key that does not exist": (
        {"key": "servicer.colour", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "section that does not exist": (
        {"key": "chaser.mass_kg", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "key that is no number": (
        {"key": "camera.model", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "key of a static setting": (
        {"key": "camera.width_px", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "a rate": ({"key": "rates.plant_hz", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)),
    "unknown kind": ({"key": "gps.noise_m", "kind": "cauchy", "sigma": 1.0}, "dispersions.0", ("'normal'",)),
    "negative sigma": (
        {"key": "gps.noise_m", "kind": "normal", "sigma": -1.0}, "dispersions.0.sigma", ("greater than or equal to 0",)
    ),
    "negative sigma of a component": (
        {"key": "thruster.position_m", "kind": "normal", "sigma": [0.0, -1.0, 0.0]},
        "dispersions.0.sigma.1",
        ("greater than or equal to 0",),
    ),
    "negative sigma of a rotation": (
        {"key": "target.attitude", "kind": "small_rotation", "sigma_deg": -1.0},
        "dispersions.0.sigma_deg",
        ("greater than or equal to 0",),
    ),
    "a word for a key": (
        {"key": 3, "kind": "direction"}, "dispersions.0.key", ("string",)
    ),
    "misspelt name": (
        {"key": "gps.noise_m", "kind": "normal", "sigmas": 1.0}, "dispersions.0.sigma", ("a value",)
    ),
    "sigma of the wrong shape": (
        {"key": "thruster.position_m", "kind": "normal", "sigma": [1.0, 1.0]}, "dispersions.0.sigma", ("(3,)",)
    ),
    "sigma of a rotation of the wrong shape": (
        {"key": "target.attitude", "kind": "small_rotation", "sigma_deg": [1.0, 1.0, 1.0, 1.0]},
        "dispersions.0.sigma_deg", ("(3,)",),
    ),
    "bounds in the wrong order": (
        {"key": "gps.noise_m", "kind": "uniform", "low": 2.0, "high": 1.0}, "dispersions.0", ("low at most high",)
    ),
    "an attitude for a vector": (
        {"key": "target.tumble_axis", "kind": "attitude"}, "dispersions.0.kind", ("4 components",)
    ),
    "a direction for a quaternion": (
        {"key": "target.attitude", "kind": "direction"}, "dispersions.0.kind", ("3 components",)
    ),
    "a kind of fault by number": (
        {"key": "faults.fault.kind", "kind": "choice", "values": [1.0, 2.0]},
        "dispersions.0.values",
        ("kinds of fault",),
    ),
    "names for a number": (
        {"key": "faults.fault.severity", "kind": "choice", "values": ["gps_outage"]},
        "dispersions.0.values",
        ("numbers",),
    ),
    "a kind of fault without choice": (
        {"key": "faults.fault.kind", "kind": "uniform", "low": 0.0, "high": 7.0}, "dispersions.0.kind", ("'choice'",)
    ),
    "a switch of the plant": (
        {"key": "effects.drag", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "model switch of the filter": (
        {"key": "navigation.zonal_degree", "kind": "normal", "sigma": 1.0}, "dispersions.0.key", ("key of a number",)
    ),
    "choices of the wrong shape": (
        {"key": "gps.noise_m", "kind": "choice", "values": [[1.0, 2.0]]}, "dispersions.0.values", ("shape ()",)
    ),
    "a log-normal over twelve decades": (
        {"key": "gps.noise_m", "kind": "log_normal", "sigma": 10.0}, "dispersions.0.sigma", ("at most 5", "3.3e+06")
    ),
    "log-normal of a vector with zeros": (
        {"key": "initial.relative_position_m", "kind": "log_normal", "sigma": 0.1}, "dispersions.0.key", ("above zero",)
    ),
}  # fmt: skip
BAD_SAMPLES: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "a mass that may be negative": (
        {"key": "servicer.mass_kg", "kind": "uniform", "low": -1.0, "high": 30.0},
        "dispersions.0.low", ("servicer.mass_kg", "greater than 0"),
    ),
    "a probability that may exceed one": (
        {"key": "camera.miss_probability", "kind": "uniform", "low": 0.5, "high": 1.5},
        "dispersions.0.high", ("less than or equal to 1",),
    ),
    "components that may be negative": (
        {"key": "wheels.torque_limit_n_m", "kind": "uniform", "low": -0.1, "high": 0.1},
        "dispersions.0.low", ("greater than 0",),
    ),
    "one mass of several that is none": (
        {"key": "servicer.mass_kg", "kind": "choice", "values": [30.0, 0.0]},
        "dispersions.0.values", ("greater than 0",),
    ),
    "one direction of several that is none": (
        {"key": "target.tumble_axis", "kind": "choice", "values": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
        "dispersions.0.values", ("not zero",),
    ),
}  # fmt: skip
BAD_DISPERSIONS |= BAD_SAMPLES


def test_bounds_of_a_uniform_are_checked_component_by_component(tables: dict[str, Any]) -> None:
    tables["dispersions"] = [{"key": "target.tumble_axis", "kind": "uniform", "low": 0.0, "high": 1.0}]
    assert scenario_loader.validate(tables).dispersions[0].key == "target.tumble_axis"


@pytest.mark.parametrize("case", BAD_DISPERSIONS.values(), ids=BAD_DISPERSIONS.keys())
def test_a_bad_dispersion_is_refused_with_its_index(
    tables: dict[str, Any], case: tuple[dict[str, Any], str, tuple[str, ...]]
) -> None:
    dispersion, key, words = case
    tables["dispersions"] = [dispersion]
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, key, *words)


def test_two_dispersions_of_one_key_are_refused(tables: dict[str, Any]) -> None:
    tables["dispersions"] = [{"key": "gps.noise_m", "kind": "normal", "sigma": 0.1}] * 2
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, "dispersions.1.key", "no other dispersion")


ONE = [[1.0]]
PAIR = ["gps.noise_m", "thruster.force_n"]


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        ([correlated(PAIR, [[1.0, 0.5], [0.4, 1.0]])], "dispersions.0.covariance: found .* expected a symmetric"),
        ([correlated(PAIR, [[1.0, 1.5], [1.5, 1.0]])], "positive semidefinite"),
        ([correlated(PAIR, [[1.0, 1.5e-3], [1.5e-3, 1e-6]])], "positive semidefinite"),
        ([correlated(PAIR, [[-1.0, 0.0], [0.0, 1.0]])], "positive semidefinite"),
        ([correlated(PAIR, [[1.0, 0.0]])], "as many columns as rows"),
        ([correlated(PAIR, ONE)], "dispersions.0.covariance: found '1 rows', expected one for each of the 2"),
        ([correlated(["initial.relative_position_m"], ONE)], "each of the 3"),
        ([correlated(["gps.noise"], ONE)], "dispersions.0.keys: found 'gps.noise', expected the key"),
        ([correlated(["servicer.inertia_kg_m2"], ONE)], "dispersions.0.keys"),
        ([correlated(["faults.fault.kind"], ONE)], "dispersions.0.keys"),
        (
            [correlated(["gps.noise_m", "gps.noise_m"], [[1.0, 0.0], [0.0, 1.0]])],
            "a key that no other dispersion draws",
        ),
        (
            [correlated(["thruster.position_m[1]"], ONE), derived("thruster.position_m", "thruster.tank_position_m")],
            "no other",
        ),
        ([derived("gps.noise_m", "gps.noise_m")], r"dispersions: found \['gps.noise_m'\]"),
        ([derived("gps.noise_m", "gps.bias_sigma_m"), derived("gps.bias_sigma_m", "gps.noise_m")], "end in others"),
        (
            [
                derived("thruster.position_m[1]", "thruster.position_m[0]"),
                derived("thruster.position_m[0]", "thruster.position_m[1]"),
            ],
            "end in others",
        ),
        ([derived("gps.noise_m", "thruster.position_m")], r"dispersions.0.terms.0.key"),
        ([derived("gps.noise_m", "gps.noise")], r"dispersions.0.terms.0.key"),
        ([derived("gps.noise_m")], r"dispersions.0.terms"),
        ([derived("thruster.position_m", "gps.noise_m", offset=[1.0, 2.0])], r"dispersions.0.offset"),
        ([derived("faults.fault.wheel", "gps.noise_m")], r"dispersions.0.kind"),
        ([derived("gps.noise_m", "faults.fault.kind")], r"dispersions.0.terms.0.key"),
    ],
)
def test_invalid_correlated_and_derived_dispersions_are_refused(
    inspection_file: ScenarioFile, entries: list[dict[str, Any]], named: str
) -> None:
    with pytest.raises(ScenarioError, match=named) as refused:
        with_sections(inspection_file, dispersions=entries, faults=[{"name": "fault", "kind": "none"}])
    assert "\n" not in str(refused.value)
