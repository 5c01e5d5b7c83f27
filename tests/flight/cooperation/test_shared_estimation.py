"""Error and consistency of the methods of sharing in a Monte Carlo with the errors that the filters believe in."""

from functools import cache

import jax
import numpy as np
import pytest
from cooperative_scene import Case, settings, simulate

from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader


@cache
def tuning() -> OrbitFilterTuning:
    file = scenario_loader.load("inspection")
    return parameters.build_params(file.model_dump(), 128, 128).flight.navigation


def late(case: Case, runs: int) -> tuple[float, float]:
    """Mean NEES of the relative state over 6, and root mean square of the range error [m], in the last half."""
    records = jax.tree.map(np.asarray, simulate(case, tuning(), runs))
    half = slice(case.ticks // 2, None)
    return records["nees"][:, half].mean() / 6.0, np.sqrt((records["range"][:, half] ** 2).mean())


def test_boxes_over_a_lossy_late_link_are_consistent_and_tell_the_range() -> None:
    nees, error = late(Case(settings(2, "boxes", period=2, delay=3), loss=0.5, ticks=800), runs=12)
    assert 0.8 < nees < 1.25
    # Alone it is 0.5 m and more.
    assert error < 0.06


@pytest.mark.slow
def test_estimates_are_cautious_and_tell_the_range() -> None:
    nees, error = late(Case(settings(2, "estimates", period=2, delay=3), loss=0.5, ticks=800), runs=12)
    assert 0.3 < nees < 1.05
    assert error < 0.06


@pytest.mark.slow
def test_estimates_fused_as_if_independent_are_over_confident() -> None:
    nees, _ = late(Case(settings(2, "naive"), ticks=400), runs=4)
    assert nees > 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("method", "least"), [("boxes", 0.75), ("estimates", 0.3)])
def test_ranges_over_the_link_tell_the_baseline_where_code_does_not(method: str, least: float) -> None:
    """Opposite each other in a relative orbit, whose bearings and the sum of whose ranges the link measures."""
    code = {"baseline_noise": 2.83, "baseline_error": 0.54, "ticks": 600}
    _, without = late(Case(settings(2, method, delay=1), **code), runs=12)
    nees, error = late(Case(settings(2, method, delay=1, ranging=True), **code), runs=12)
    assert least < nees < 1.3
    assert error < 0.8 * without


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5, 0.9])
def test_error_and_consistency_at_any_loss(loss: float) -> None:
    _, alone = late(Case(settings(2, "boxes"), alone=True), runs=48)
    nees_central, central = late(Case(settings(2, "central")), runs=48)
    nees_boxes, boxes = late(Case(settings(2, "boxes"), loss=loss), runs=48)
    nees_estimates, estimates = late(Case(settings(2, "estimates"), loss=loss), runs=48)
    assert 0.8 < nees_central < 1.25
    assert 0.8 < nees_boxes < 1.25
    assert 0.3 < nees_estimates < 1.05
    assert 4.0 * boxes < alone
    if loss == 0.0:
        assert boxes < 1.05 * central
        assert estimates < 1.3 * central
