"""Drivers of events: planted single and pair effects are found, chance is not, and pairs are told from two singles."""

import numpy as np
import pytest

from rpojax.analysis.statistics.drivers import drivers

RUNS = 1000


def inputs(seed: int, count: int = 12) -> dict[str, np.ndarray]:
    """Normal, uniform and four-valued inputs in turn."""
    rng = np.random.default_rng(seed)
    kinds = (rng.normal, rng.uniform, lambda size: rng.integers(0, 4, size).astype(float))
    return {f"x{number:02}": kinds[number % 3](size=RUNS) for number in range(count)}


def high(values: np.ndarray) -> np.ndarray:
    """Flags of the upper half of an input; of four values the upper two."""
    return values > (1.5 if len(np.unique(values)) == 4 else np.median(values))


def names(found: list) -> list[tuple[str, ...]]:
    """Inputs of each driver."""
    return [one.inputs for one in found]


@pytest.mark.parametrize("name", ["x00", "x01", "x02"])
def test_a_single_effect_is_found_alone(name: str) -> None:
    given = inputs(1)
    event = np.random.default_rng(2).random(RUNS) < np.where(high(given[name]), 0.2, 0.05)
    [found] = drivers(given, {"fails": event})
    assert found.inputs == (name,)
    assert (found.runs.sum(), found.events.sum()) == (RUNS, event.sum())
    assert found.events[-1] / found.runs[-1] > 2.0 * found.events[0] / found.runs[0]


def test_an_effect_of_both_tails_is_found() -> None:
    given = inputs(3)
    event = np.random.default_rng(4).random(RUNS) < np.where(np.abs(given["x00"]) > 1.5, 0.3, 0.05)
    found = drivers(given, {"fails": event})
    assert names(found) == [("x00",)]
    assert found[0].events[1] == min(found[0].events)


@pytest.mark.parametrize("pair", [("x00", "x01"), ("x00", "x05"), ("x02", "x05")])
def test_a_pair_is_found_beyond_its_single_effects(pair: tuple[str, str]) -> None:
    given = inputs(5)
    both = high(given[pair[0]]) & high(given[pair[1]])
    event = np.random.default_rng(6).random(RUNS) < np.where(both, 0.3, 0.05)
    found = drivers(given, {"fails": event})
    assert pair in names(found)
    # The level allows for a false one now and then.
    assert sum(not set(each) <= set(pair) for each in names(found)) <= 1


def test_two_causes_that_act_independently_are_no_pair() -> None:
    reported = 0
    for seed in range(10):
        given = inputs(seed, 6)
        spared = np.where(high(given["x00"]), 0.8, 0.95) * np.where(high(given["x01"]), 0.8, 1.0)
        event = np.random.default_rng(100 + seed).random(RUNS) > spared
        found = names(drivers(given, {"fails": event}))
        assert {("x00",), ("x01",)} <= set(found)
        reported += sum(len(each) == 2 for each in found)
    assert reported <= 1


def test_a_pair_without_single_effects_is_found() -> None:
    given = inputs(7)
    event = np.random.default_rng(8).random(RUNS) < np.where(high(given["x00"]) ^ high(given["x01"]), 0.3, 0.05)
    assert names(drivers(given, {"fails": event})) == [("x00", "x01")]


def test_categories_are_compared_value_by_value_and_paired() -> None:
    given = inputs(9)
    kind = np.random.default_rng(10).integers(0, 3, RUNS).astype(float)
    given["kind"] = kind
    event = np.random.default_rng(11).random(RUNS) < np.where((kind == 1.0) & high(given["x00"]), 0.4, 0.05)
    found = drivers(given, {"fails": event}, categorical=["kind"])
    assert ("kind", "x00") in names(found)
    [pair] = [one for one in found if one.inputs == ("kind", "x00")]
    assert pair.parts[0] == (0.0, 1.0, 2.0)
    assert np.unravel_index(np.argmax(pair.events / pair.runs), pair.runs.shape) == (1, 2)


def test_chance_is_hardly_ever_reported() -> None:
    false = 0
    for seed in range(20):
        rng = np.random.default_rng(200 + seed)
        false += bool(drivers(inputs(seed), {"rare": rng.random(RUNS) < 0.02, "often": rng.random(RUNS) < 0.3}))
    # Two families at 2 % each: at most 0.8 data sets of twenty expected, and five with probability 0.002.
    assert false < 5


def test_runs_that_do_not_count_and_events_of_few_runs_are_left_out() -> None:
    given = inputs(12)
    event = (np.random.default_rng(13).random(RUNS) < np.where(high(given["x00"]), 0.3, 0.05)).astype(float)
    event[:300] = np.nan
    [found] = drivers(given, {"fails": event, "once": np.arange(RUNS) == 3, "always": np.ones(RUNS)})
    assert (found.event, found.runs.sum()) == ("fails", 700)
    assert drivers({}, {"fails": event}) == []
    assert drivers(given, {}) == []
