"""Both reductions over time of hand-made quantities, against values worked out by hand."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.errors import RpojaxError
from rpojax.metrics import record_statistics
from rpojax.metrics.metric_definition import Metric, RunTiming, WeightedValue
from rpojax.metrics.recorded_reduction import reduce_records
from rpojax.metrics.running_reduction import accumulate, final_values, initial_accumulators

TIMING = RunTiming(tick_s=1.0, decision_ticks=2)
QUANTITIES = {
    "scalar": np.array([4.0, -1.0, 2.0, 3.0, 2.0, 6.0]),
    "vector": np.array([[0.0, 3.0, -4.0], [0.0, 0.0, 0.0], *4 * [[1.0, 2.0, -2.0]]]),
    "flag": np.array([True, False, True, False, True, True]),
    "never": np.zeros(6, dtype=bool),
    "early": np.array([True, True, False, False, False, False]),
    "undefined_at_the_end": np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan]),
    "undefined": np.array([1.0, np.nan, 3.0, np.nan, 5.0, 3.0]),
}
"""Six ticks: the late window begins at the third, the last window at the fifth."""


def metric(inputs: tuple[str, ...], **definition: Any) -> Metric:
    """A definition without texts."""
    return Metric("test", "-", title="", meaning="", inputs=inputs, **definition)


def recorded(definition: Metric) -> float:
    """Metric of a record of one run."""
    return float(reduce_records(definition, {name: value[None] for name, value in QUANTITIES.items()}, TIMING)[0])


def running(definition: Metric) -> float:
    """Metric accumulated tick by tick."""
    sums = initial_accumulators([definition])
    for tick in range(6):
        quantities = {name: jnp.asarray(QUANTITIES[name][tick]) for name in definition.inputs}
        sums = accumulate([definition], quantities, sums, jnp.int32(tick), 6, TIMING.tick_s)
    return float(final_values([definition], sums)[0])


def weighted(_: Any, value: Any, weight: Any) -> WeightedValue:
    """The first input, weighted by the second."""
    return WeightedValue(value, weight)


REDUCTIONS = ("mean", "rms", "sum", "min", "max", "end", "total")


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_a_metric_is_undefined_where_no_tick_counts(reduction: str) -> None:
    never = metric(("scalar", "never"), value=weighted, reduction=reduction)
    assert np.isnan([recorded(never), running(never)]).all()


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_a_metric_is_undefined_where_no_tick_of_its_window_counts(reduction: str) -> None:
    early = metric(("scalar", "early"), value=weighted, reduction=reduction, window="late")
    assert np.isnan([recorded(early), running(early)]).all()


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_a_metric_is_undefined_where_a_value_that_counts_is(reduction: str) -> None:
    for name in ("undefined", "undefined_at_the_end"):
        given = metric((name,), reduction=reduction)
        only_end = reduction in ("end", "total") and name == "undefined"
        assert np.isnan([recorded(given), running(given)]).all() != only_end


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_an_undefined_metric_has_a_derivative_of_zero_and_leaves_that_of_others_finite(reduction: str) -> None:
    never = metric(("scalar", "never"), value=weighted, reduction=reduction)
    often = metric(("scalar",), reduction=reduction)

    def values(factor: jax.Array) -> jax.Array:
        sums = initial_accumulators([never, often])
        for tick in range(6):
            quantities = {"scalar": factor * QUANTITIES["scalar"][tick], "never": jnp.asarray(False)}
            sums = accumulate([never, often], quantities, sums, jnp.int32(tick), 6, TIMING.tick_s)
        return final_values([never, often], sums)

    for derivative in (jax.jacfwd(values)(1.0), jax.jacrev(values)(1.0)):
        # Each reduction is homogeneous of degree one.
        np.testing.assert_allclose(derivative, [0.0, recorded(often)], rtol=1e-14)


@pytest.mark.parametrize(
    ("definition", "expected"),
    [
        (metric(("vector", "flag"), value=weighted, reduction="mean"), 2.0 / 12.0),
        (metric(("vector", "flag"), value=weighted, reduction="sum"), 2.0),
        (metric(("scalar", "flag"), value=weighted, reduction="end"), 6.0),
        (metric(("scalar",), reduction="mean"), 16.0 / 6.0),
        (metric(("scalar",), reduction="mean", window="late"), 13.0 / 4.0),
        (metric(("scalar",), reduction="rms", window="last"), np.sqrt(20.0)),
        (metric(("scalar",), reduction="sum"), 16.0),
        (metric(("scalar",), reduction="min"), -1.0),
        (metric(("scalar",), reduction="min", window="late"), 2.0),
        (metric(("scalar",), reduction="max", window="all"), 6.0),
        (metric(("scalar",), reduction="end"), 6.0),
        (metric(("vector",), reduction="rms"), np.sqrt((25.0 + 4.0 * 9.0) / 6.0)),
        (metric(("vector",), reduction="mean"), 3.0 / 18.0),
        (metric(("vector",), reduction="sum", window="last"), 2.0),
        (metric(("vector",), reduction="min"), -4.0),
        (metric(("vector",), reduction="max", window="late"), 2.0),
        (metric(("flag",), reduction="mean"), 4.0 / 6.0),
        (metric(("undefined", "flag"), value=weighted, reduction="mean"), 3.0),
        (metric(("undefined", "flag"), value=weighted, reduction="rms"), np.sqrt(11.0)),
        (metric(("undefined", "flag"), value=weighted, reduction="sum"), 12.0),
        (metric(("scalar", "flag"), value=weighted, reduction="min"), 2.0),
        (metric(("undefined", "flag"), value=weighted, reduction="max"), 5.0),
    ],
)
def test_both_reductions_have_the_value_by_hand(definition: Metric, expected: float) -> None:
    np.testing.assert_allclose([recorded(definition), running(definition)], expected, rtol=1e-15)


def test_the_namespace_is_that_of_the_quantities() -> None:
    definition = metric(("scalar",), value=lambda xp, scalar: xp.maximum(scalar, 0.0), reduction="sum")
    assert recorded(definition) == running(definition) == 17.0


def test_a_statistic_of_whole_records_cannot_be_accumulated() -> None:
    definition = metric(("flag",), reduction=record_statistics.longest_streak)
    assert recorded(definition) == 2.0
    with pytest.raises(RpojaxError, match="test: found accumulation during the simulation, expected whole records"):
        running(definition)


def test_a_metric_of_the_simulation_alone_has_no_value_from_records() -> None:
    with pytest.raises(RpojaxError, match="test: found records, expected accumulation during the simulation"):
        recorded(metric(("scalar",), reduction="mean", source="simulation"))
