"""Metrics accumulated during the simulation against those of recorded channels."""

from collections.abc import Iterator

import fault_and_eclipse_runs
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fault_and_eclipse_runs import TICKS, Runs
from synthetic_channel_records import SINGLE

from rpojax.core.pytree import replace
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Metric
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.metrics import recorded_metrics, running_metrics
from rpojax.simulation.metrics.running_metrics import RunningSums
from rpojax.simulation.telemetry import Telemetry

ADDED = Metric(
    "max_range_m", "m", title="Greatest range", meaning="Of the spacecraft.", inputs=("range_m",), reduction="max"
)
RUNNING = [name for name, metric in METRICS.items() if isinstance(metric.reduction, str) and metric.needs is None]
SHARED = [name for name in RUNNING if METRICS[name].source == "records"]
Results = tuple[dict[str, float], dict[str, np.ndarray], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def results(runs: Runs) -> Iterator[Results]:
    """Accumulated metrics of a run with burns, metrics of its records, and the records."""
    file, scenario, params = fault_and_eclipse_runs.nominal()
    names = (*RUNNING, ADDED.name)
    accumulated = [*(METRICS[name] for name in RUNNING), ADDED]

    @jax.jit
    def accumulate(telemetry: Telemetry) -> tuple[jax.Array, Channels]:
        def body(sums: RunningSums, seen: Telemetry) -> tuple[RunningSums, Channels]:
            sums = running_metrics.add_tick(accumulated, scenario, params, seen, sums)
            return sums, compute_channels(scenario, params, seen)

        sums, channels = jax.lax.scan(body, running_metrics.initial_sums(accumulated), telemetry)
        return running_metrics.final_values(accumulated, sums), channels

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METRICS, ADDED.name, ADDED)
        metrics, channels = accumulate(runs["none"][1])
        records = {name: np.asarray(values)[None] for name, values in channels.items()}
        yield dict(zip(names, map(float, metrics), strict=True)), recorded_metrics.evaluate(file, records, {}), records


@pytest.mark.parametrize("name", SHARED)
def test_a_metric_equals_that_of_the_records(name: str, results: Results) -> None:
    metrics, expected, _ = results
    np.testing.assert_allclose(metrics[name], expected[name][0], rtol=2e-5)


def test_a_metric_that_is_added_to_the_catalogue_is_evaluated_in_both_ways(results: Results) -> None:
    metrics, expected, records = results
    assert expected["max_range_m"][0] == records["range_m"].max() > expected["min_range_m"][0]
    np.testing.assert_allclose(metrics["max_range_m"], expected["max_range_m"][0], rtol=SINGLE)


def test_the_run_has_a_burn_and_a_pointing_error(results: Results) -> None:
    metrics, _, _ = results
    assert metrics["delta_v_m_s"] > 0.0
    assert 0.0 < metrics["pointing_error_rms_deg"] < 1.0
    assert metrics["estimate_surprise"] != pytest.approx(0.0, abs=0.1)


def test_the_pointing_error_is_of_settled_pointing_only(results: Results) -> None:
    metrics, _, records = results
    looking = records["mode"][0] == Mode.LOOK
    settled = np.array([looking[max(0, tick - 5) : tick + 1].all() for tick in range(TICKS)])
    settled[: TICKS // 3] = False
    expected = np.sqrt(np.mean(records["pointing_error_deg"][0][settled] ** 2))
    np.testing.assert_allclose(metrics["pointing_error_rms_deg"], expected, rtol=1e-4)


def test_a_metric_without_any_tick_is_undefined_with_zero_derivative() -> None:
    accumulated = [METRICS[name] for name in ("nis_box_mean", "formation_error_rms_m")]

    def last(x: jax.Array) -> jax.Array:
        sums = running_metrics.initial_sums(accumulated)
        return running_metrics.final_values(
            accumulated,
            RunningSums(
                accumulators=replace(sums.accumulators, total=sums.accumulators.total * x),
                pointing_ticks=sums.pointing_ticks,
                event_hash=sums.event_hash,
            ),
        )

    value, derivative = jax.jvp(last, (jnp.ones(()),), (jnp.ones(()),))
    np.testing.assert_array_equal(value, np.nan)
    np.testing.assert_array_equal(derivative, 0.0)
