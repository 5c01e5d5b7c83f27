"""Inputs of failing and passing runs compared, against worked numbers and where the cause is known."""

import numpy as np
import pytest

from rpojax.analysis.statistics.dependence import group_difference, separate_failing_runs


def test_failing_against_passing_inputs_against_worked_numbers() -> None:
    found = group_difference(np.arange(1.0, 6.0), np.arange(4.0, 9.0))
    assert found.ks_distance == pytest.approx(0.6, rel=1e-12)
    assert found.ks_p == pytest.approx(0.357143, abs=5e-7)
    assert found.auc * 25.0 == pytest.approx(23.0, rel=1e-12)
    assert found.auc_p == pytest.approx(0.035579, abs=5e-7)


def test_what_separates_failing_runs_comes_first_with_its_side() -> None:
    rng = np.random.default_rng(7)
    inputs = {f"noise{i}": rng.normal(size=400) for i in range(5)} | {"cause": rng.normal(size=400)}
    failing = inputs["cause"] < -1.5
    first, *rest = separate_failing_runs(inputs, failing)
    assert first.name == "cause"
    assert (first.difference.ks_distance, first.difference.auc) == (1.0, 0.0)
    assert first.difference.ks_p < 1e-6
    assert all(one.difference.ks_p > 0.05 and one.difference.auc_p > 0.05 for one in rest)
    alone = group_difference(inputs["noise0"][~failing], inputs["noise0"][failing])
    assert next(one for one in rest if one.name == "noise0").difference.ks_p >= alone.ks_p


def test_without_failing_or_passing_runs_nothing_is_separated() -> None:
    assert separate_failing_runs({"x": np.arange(4.0)}, np.zeros(4, bool)) == ()
    assert separate_failing_runs({"x": np.arange(4.0)}, np.ones(4, bool)) == ()
