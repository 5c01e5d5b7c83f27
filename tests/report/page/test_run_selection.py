"""Selection of the run that is shown in detail."""

import numpy as np
import pytest

from rpojax.errors import ResultError
from rpojax.report.page.detail_values import choose_run


def test_default_run_has_the_median_formation_error(build):
    campaign = build(runs=9, kept=(1, 4, 7))
    campaign.metrics["formation_error_rms_m"] = np.array([0.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0])
    assert choose_run(campaign) == 7
    assert choose_run(campaign, 4) == 4


def test_failed_run_is_selected_only_without_others(build):
    assert choose_run(build(runs=4, kept=(1, 2), failed=(1,))) == 2
    assert choose_run(build(runs=4, kept=(1, 2), failed=(0, 1, 2, 3))) == 1
    assert choose_run(build(runs=4, kept=())) is None


def test_run_without_history_is_an_error(campaign):
    with pytest.raises(ResultError, match="run 30"):
        choose_run(campaign, 30)
