"""Declared laws of dispersed numbers, against draws made as the scenario's documentation says."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm

from rpojax.analysis.statistics.dispersion_marginals import declared_nominal, drawn_marginals, goodness_of_fit_p
from rpojax.dispersions.marginal_distribution import DiscreteDistribution

RUNS = 3000
SCENARIO: dict[str, Any] = {
    "servicer": {"mass_kg": 24.0, "offset_m": [1.0, -2.0, 0.0]},
    "target": {"axis": [0.0, 0.0, 1.0], "attitude": [0.5, -0.5, 0.1, 0.7]},
    "faults": [{"name": "fault", "kind": "none"}],
}


def _draw(rng: np.random.Generator, kind: str) -> tuple[dict[str, Any], np.ndarray]:
    """A dispersion and draws of it that owe nothing to the module under test."""
    start = Rotation.from_quat(np.roll(np.array(SCENARIO["target"]["attitude"]), -1))
    on_sphere = rng.normal(size=(RUNS, 4))
    turns = Rotation.from_rotvec(np.radians([0.5, 1.0, 2.0]) * rng.normal(size=(RUNS, 3)))
    mass, offset = "servicer.mass_kg", "servicer.offset_m"
    vectors = rng.normal(size=(RUNS, 3))
    found: dict[str, tuple[dict[str, Any], np.ndarray]] = {
        "normal": ({"key": offset, "sigma": [0.1, 0.2, 0.3]}, [1.0, -2.0, 0.0] + np.array([0.1, 0.2, 0.3]) * vectors),
        "truncated_normal": (
            {"key": mass, "sigma": 2.0, "limit_sigmas": 1.0},
            24.0 + 2.0 * truncnorm(-1.0, 1.0).rvs(RUNS, random_state=rng),
        ),
        "uniform": ({"key": offset, "low": -1.0, "high": 3.0}, rng.uniform(-1.0, 3.0, (RUNS, 3))),
        "log_normal": ({"key": mass, "sigma": 0.3}, 24.0 * np.exp(0.3 * rng.normal(size=RUNS))),
        "choice": ({"key": mass, "values": [20.0, 24.0, 24.0]}, rng.choice([20.0, 24.0, 24.0], RUNS)),
        "direction": ({"key": "target.axis"}, vectors / np.linalg.norm(vectors, axis=1, keepdims=True)),
        "attitude": ({"key": "target.attitude"}, on_sphere / np.linalg.norm(on_sphere, axis=1, keepdims=True)),
        "small_rotation": (
            {"key": "target.attitude", "sigma_deg": [0.5, 1.0, 2.0]},
            np.roll((turns * start).as_quat(), 1, axis=1),
        ),
        "correlated_normal": (
            {"keys": ["servicer.offset_m[1]", mass], "covariance": [[4.0, 1.0], [1.0, 1.0]]},
            24.0 + rng.normal(size=RUNS),
        ),
    }
    entry, values = found[kind]
    return {**entry, "kind": kind}, values


@pytest.mark.parametrize(
    "kind",
    [
        *("normal", "truncated_normal", "uniform", "log_normal", "choice", "direction", "attitude", "small_rotation"),
        "correlated_normal",
    ],
)
def test_draws_follow_the_law_that_they_were_made_by_and_no_wider_one(kind: str) -> None:
    entry, values = _draw(np.random.default_rng(11), kind)
    key = entry.get("key", "servicer.mass_kg")
    found = drawn_marginals({**SCENARIO, "dispersions": [entry]}, {key: values})
    assert found
    for one in found:
        assert one.distribution is not None
        # One in a thousand, for some twenty tests with this seed.
        assert goodness_of_fit_p(one.values, one.distribution) > 1e-3
        middle, spread = one.distribution.mean(), one.distribution.std()
        assert np.mean(one.values) == pytest.approx(middle, abs=5.0 * spread / np.sqrt(RUNS))
        assert np.std(one.values) == pytest.approx(spread, rel=0.15)
        assert goodness_of_fit_p(middle + 1.3 * (one.values - middle), one.distribution) < 1e-6


def test_a_turned_quaternion_is_shown_about_each_axis_whatever_its_sign() -> None:
    entry, values = _draw(np.random.default_rng(2), "small_rotation")
    scenario = {**SCENARIO, "dispersions": [entry]}
    found = drawn_marginals(scenario, {"target.attitude": values})
    assert [one.name for one in found] == [f"target.attitude[about {axis}, deg]" for axis in "xyz"]
    flipped = drawn_marginals(scenario, {"target.attitude": -values})
    np.testing.assert_allclose(flipped[1].values, found[1].values, atol=1e-12)
    still = drawn_marginals(scenario, {"target.attitude": np.array([SCENARIO["target"]["attitude"]])})
    np.testing.assert_allclose([one.values[0] for one in still], 0.0, atol=1e-6)


def test_constants_derived_values_and_values_of_a_table_have_no_law() -> None:
    entries = [
        {"key": "servicer.offset_m", "kind": "normal", "sigma": [0.1, 0.0, 0.1]},
        {"key": "servicer.mass_kg", "kind": "uniform", "low": 1.0, "high": 2.0},
    ]
    drawn = {"servicer.offset_m": np.zeros((4, 3)), "servicer.mass_kg": np.zeros(4), "unknown": np.zeros(4)}
    known = {
        one.name: one.distribution is not None for one in drawn_marginals({**SCENARIO, "dispersions": entries}, drawn)
    }
    assert known == {
        "servicer.offset_m[0]": True,
        "servicer.offset_m[1]": False,
        "servicer.offset_m[2]": True,
        "servicer.mass_kg": True,
        "unknown": False,
    }
    tabled = {**SCENARIO, "dispersions": entries, "design": {"kind": "table", "values": {"servicer.mass_kg": [1.0]}}}
    assert [one.distribution for one in drawn_marginals(tabled, drawn) if one.name == "servicer.mass_kg"] == [None]
    derived = {"key": "servicer.mass_kg", "kind": "derived", "offset": 1.0, "terms": []}
    assert (
        drawn_marginals({**SCENARIO, "dispersions": [derived]}, {"servicer.mass_kg": np.ones(3)})[0].distribution
        is None
    )


def test_a_choice_counts_its_values_and_refuses_others() -> None:
    law = DiscreteDistribution(np.array([0.0, 5.0]), np.array([0.25, 0.75]))
    # Pearson with one degree of freedom: (30 - 25)^2 / 25 + (70 - 75)^2 / 75 = 4/3, whose tail is 0.2482.
    assert goodness_of_fit_p(np.repeat([0.0, 5.0], [30, 70]), law) == pytest.approx(0.2482, abs=5e-5)
    assert goodness_of_fit_p(np.array([0.0, 5.0, 7.0]), law) == 0.0


def test_every_element_of_a_matrix_has_its_law() -> None:
    scenario = {
        "servicer": {"inertia_kg_m2": [[1.0, 0.0], [0.0, 2.0]]},
        "dispersions": [{"key": "servicer.inertia_kg_m2", "kind": "normal", "sigma": 0.1}],
    }
    found = drawn_marginals(scenario, {"servicer.inertia_kg_m2": np.zeros((3, 2, 2))})
    assert [one.name for one in found] == [f"servicer.inertia_kg_m2[{index}]" for index in range(4)]
    assert [one.distribution and one.distribution.mean() for one in found] == [1.0, 0.0, 0.0, 2.0]


def test_nominal_values_of_keys_components_and_kinds_of_faults() -> None:
    assert declared_nominal(SCENARIO, "servicer.mass_kg") == 24.0
    assert declared_nominal(SCENARIO, "servicer.offset_m[1]") == -2.0
    assert declared_nominal(SCENARIO, "faults.fault.kind") == 0
    assert declared_nominal(SCENARIO, "servicer.offset_m[7]") is None
    assert declared_nominal(SCENARIO, "nothing.here") is None
