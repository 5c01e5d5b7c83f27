"""Metrics accumulated during the simulation against those of recorded channels."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_channel_records import SINGLE

import rpojax
from rpojax.campaign import single_run
from rpojax.core.pytree import replace
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Metric
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.metrics import recorded_metrics, running_metrics
from rpojax.simulation.metrics.running_metrics import RunningSums
from rpojax.simulation.state import State
from rpojax.simulation.step import step

ADDED = Metric(
    "max_range_m", "m", title="Greatest range", meaning="Of the spacecraft.", inputs=("range_m",), reduction="max"
)
RUNNING = [name for name, metric in METRICS.items() if isinstance(metric.reduction, str)]
SHARED = [name for name in RUNNING if METRICS[name].source == "records"]
Results = tuple[dict[str, float], dict[str, np.ndarray], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def results() -> Iterator[Results]:
    """Accumulated metrics of a run of 240 s with a burn, metrics of its records, and the records."""
    file = rpojax.load("inspection", ["duration_s=240.0", "rates.formation_period_s=120.0"])
    scenario, params, state = single_run.initialise_run(file, seed=0, run_id=3)
    names = (*RUNNING, ADDED.name)
    accumulated = [*(METRICS[name] for name in RUNNING), ADDED]

    @jax.jit
    def simulate(state: State) -> tuple[jax.Array, Channels]:
        def body(carry: tuple[State, RunningSums], _: None) -> tuple[tuple[State, RunningSums], object]:
            state, sums = carry
            after, telemetry = step(scenario, params, state, rpojax.Stages())
            sums = running_metrics.add_tick(accumulated, scenario, params, telemetry, sums)
            return (after, sums), compute_channels(scenario, params, telemetry)

        start = (state, running_metrics.initial_sums(accumulated))
        (_, sums), channels = jax.lax.scan(body, start, None, length=scenario.ticks)
        return running_metrics.final_values(accumulated, sums), channels

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METRICS, ADDED.name, ADDED)
        metrics, channels = simulate(state)
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
    settled = np.array([looking[max(0, tick - 5) : tick + 1].all() for tick in range(240)])
    settled[:80] = False
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
