"""Rankings of inputs where the answer is known."""

import numpy as np
import pytest

from rpojax.analysis.statistics.dependence import rank_inputs


def ishigami(points: np.ndarray) -> np.ndarray:
    """Ishigami's function with a = 7, b = 0.1: only x has a monotonic effect, all three inputs have one."""
    x, y, z = points.T
    return np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def test_the_two_methods_disagree_on_ishigamis_function() -> None:
    points = np.random.default_rng(0).uniform(-np.pi, np.pi, (800, 3))
    found = rank_inputs(dict(zip("xyz", points.T, strict=True)), ishigami(points))
    assert found.leading_by_spearman == ("x",)
    assert set(found.leading_by_hsic) == {"x", "y", "z"}
    assert found.disagree
    numbers = {one.name: one for one in found.inputs}
    # Over many draws: ranks .42, -.04, .01 and HSIC .144, .011, .027.
    assert [numbers[name].spearman for name in "xyz"] == pytest.approx([0.42, -0.04, 0.01], abs=0.05)
    assert [numbers[name].hsic for name in "xyz"] == pytest.approx([0.144, 0.011, 0.027], abs=0.01)


def test_a_monotonic_influence_leads_by_both_and_noise_by_neither() -> None:
    rng = np.random.default_rng(8)  # one seed in twenty names a noise as well
    inputs = {f"noise{i}": rng.normal(size=1500) for i in range(12)}
    inputs |= {"strong": rng.normal(size=1500), "weak": rng.normal(size=1500), "fixed": np.ones(1500)}
    metric = np.exp(inputs["strong"]) + 0.7 * inputs["weak"] + 0.2 * rng.normal(size=1500)
    metric[::10] = np.nan
    found = rank_inputs(inputs, metric, seed=3)
    assert found.leading_by_spearman == found.leading_by_hsic == ("strong", "weak")
    assert not found.disagree
    assert (found.runs, found.sampled) == (1350, 1000)
    assert [one.name for one in found.inputs[:2]] == ["strong", "weak"]
    assert "fixed" not in {one.name for one in found.inputs}
    assert rank_inputs(inputs, metric, seed=3) == found


def test_p_values_of_unrelated_inputs_are_seldom_below_a_twentieth() -> None:
    rng = np.random.default_rng(6)
    false_alarms = 0
    for seed in range(40):
        found = rank_inputs({"a": rng.normal(size=60), "b": rng.normal(size=60)}, rng.normal(size=60), seed)
        false_alarms += bool(found.leading_by_hsic)
    # At most a twentieth of forty; eight has a probability below 1e-3.
    assert false_alarms < 8


def test_nothing_is_ranked_without_enough_runs_or_where_nothing_varies() -> None:
    inputs = {"x": np.arange(40.0)}
    assert rank_inputs(inputs, np.where(np.arange(40) < 9, np.arange(40.0), np.nan)).inputs == ()
    assert rank_inputs(inputs, np.ones(40)).inputs == ()
    assert rank_inputs({"x": np.ones(40)}, np.arange(40.0)).inputs == ()
