"""Histories that are kept for their results while blocks are stored."""

import numpy as np
import pytest

from rpojax.campaign.execution.selected_histories import SelectionSoFar, selected_by_result
from rpojax.campaign.options.history_retention import Retention

REQUIRED = [("formation_error_rms_m", False), ("min_range_m", True)]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rule", ["requirements", "2+failures+worst:3:delta_v_m_s", "worst:2:min_range_m", "8"])
def test_selection_by_blocks_in_any_order_is_that_of_all_runs_at_once(rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    run_ids, failed, metrics = random_runs(rng, 40)
    stored: set[int] = set()
    selection = SelectionSoFar(Retention(rule), REQUIRED)
    for block in rng.permutation(8):
        rows = slice(5 * block, 5 * block + 5)
        displaced = selection.add(run_ids[rows], failed[rows], {name: values[rows] for name, values in metrics.items()})
        assert displaced <= stored
        stored = (stored | set(selection.run_ids.tolist())) - displaced
        assert len(stored) <= 2 + 3 + int((failed).sum())  # those displaced do not pile up
    assert stored == selected_by_result(Retention(rule), run_ids, failed, metrics, REQUIRED)


def test_the_worst_run_of_a_requirement_is_that_nearest_to_its_limit_whatever_the_metric_says() -> None:
    values, none = np.array([3.0, 1.0, 2.0, np.nan]), np.zeros(4, bool)
    both = [("final_range_m", False), ("nees_mean", True)]
    for metric, low_is_bad in both:
        kept = selected_by_result(
            Retention("requirements"), np.arange(4), none, {metric: values}, [(metric, low_is_bad)]
        )
        assert kept == {1 if low_is_bad else 0}


def random_runs(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Runs with equal values and undefined ones among their metrics."""
    names = [*(metric for metric, _ in REQUIRED), "delta_v_m_s"]
    metrics = {name: rng.choice([0.0, 0.5, 1.0, 2.0, np.nan], count) for name in names}
    return 100 + np.arange(count), rng.random(count) < 0.1, metrics
