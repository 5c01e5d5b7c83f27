"""The catalogue is consistent, and free of JAX."""

import subprocess
import sys

from rpojax.metrics import metric_catalogue
from rpojax.metrics.metric_catalogue import DIFFERENTIABLE, METRICS, UNITS
from rpojax.simulation.channels import (
    CHANNELS,
    ISOLATION_CHANNELS,
    LANDMARK_CHANNELS,
    PLUME_CHANNELS,
    PORT_CHANNELS,
)
from rpojax.simulation.metrics import recorded_metrics


def test_no_metric_hides_another_of_the_same_name() -> None:
    assert len(METRICS) == sum(len(module.METRICS) for module in metric_catalogue.MODULES)


def test_every_metric_can_be_evaluated_in_at_least_one_way() -> None:
    accumulated = {name for name, metric in METRICS.items() if isinstance(metric.reduction, str)}
    assert set(DIFFERENTIABLE) <= accumulated
    assert set(UNITS) | accumulated == set(METRICS)


def test_metrics_of_records_are_made_of_channels() -> None:
    assert set(recorded_metrics.REQUIRED_CHANNELS) <= set(CHANNELS)
    of_some = {*LANDMARK_CHANNELS, *PORT_CHANNELS, *PLUME_CHANNELS, *ISOLATION_CHANNELS}
    assert set(recorded_metrics.OPTIONAL_CHANNELS) <= of_some - set(CHANNELS)


def test_the_catalogue_is_free_of_jax() -> None:
    code = "import sys, rpojax.metrics.metric_catalogue; print('jax' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
