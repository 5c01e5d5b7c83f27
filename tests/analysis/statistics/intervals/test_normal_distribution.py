"""Probabilities of a normal number against worked numbers."""

import pytest

from rpojax.analysis.statistics.intervals import Z_95, coverage_per_axis


def test_coverage_against_worked_numbers() -> None:
    assert coverage_per_axis(3.0) == pytest.approx(0.9973002, abs=5e-8)
    assert coverage_per_axis(Z_95) == pytest.approx(0.95, abs=5e-6)
