"""Metrics of a team from those of its servicers, and from their channels."""

import numpy as np

from rpojax.metrics import metric_catalogue
from rpojax.simulation.metrics import team_metrics

EACH = np.array([[1.0, 3.0], [np.nan, 5.0], [np.nan, np.nan]])


def test_errors_are_means_and_ranges_least_and_peaks_greatest() -> None:
    def joined(name: str) -> list[float]:
        return team_metrics.joined(metric_catalogue.find(name), EACH).tolist()

    assert joined("formation_error_rms_m")[:2] == [2.0, 5.0]
    assert joined("min_range_m")[:2] == [1.0, 5.0]
    assert joined("passive_range_24_h_m")[:2] == [1.0, 5.0]
    assert joined("passive_unsafe_fraction")[:2] == [3.0, 5.0]
    assert np.isnan(joined("formation_error_rms_m")[2])


def test_separation_and_the_time_without_any_box() -> None:
    rho = np.zeros((1, 4, 3, 2))
    rho[0, :, 0, 1] = [5.0, 4.0, 3.0, 6.0]
    accepted = np.array([[[False, False], [True, False], [False, False], [False, True]]])
    records = {"rho_H": rho, "box_accepted": accepted, "box_outlier": np.zeros_like(accepted)}
    found = team_metrics.evaluate(2.0, records)
    assert found["min_separation_m"].tolist() == [3.0]
    assert found["team_unseen_peak_s"].tolist() == [2.0]


def test_metric_of_one_servicer_has_the_unit_of_the_metric() -> None:
    metric = metric_catalogue.find("min_range_m/beta")
    assert metric is not None
    assert (metric.unit, metric.name, metric.low_is_bad) == ("m", "min_range_m/beta", True)
    assert not metric_catalogue.is_of_campaigns("min_range_m/beta")
