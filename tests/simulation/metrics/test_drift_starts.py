"""Starts of free drifts from hand-made records."""

import numpy as np

from rpojax.simulation.metrics.drift_starts import drift_starts

TICKS = 100


def record(burns: tuple[tuple[int, int], ...], running: int = TICKS) -> dict[str, np.ndarray]:
    """Channels of a run with burns from one tick to another, 1 mm/s in a tick."""
    delta_v = np.zeros(TICKS, np.float32)
    for begin, end in burns:
        delta_v += 1e-3 * np.clip(np.arange(TICKS) - begin, 0, end - begin).astype(np.float32)
    place = np.arange(TICKS, dtype=np.float32)[:, None] * np.array([1.0, 10.0, 100.0], np.float32)
    return {
        "r_ST_N": place,
        "v_ST_N": -place,
        "mass_kg": np.linspace(30.0, 29.0, TICKS),
        "delta_v_m_s": delta_v,
        "running": np.arange(TICKS) < running,
    }


def test_a_coast_is_one_drift_to_its_last_instant() -> None:
    found = drift_starts(record(()), 30)
    assert found.instants.tolist() == [0, 30, 60, 90]
    assert (found.ticks.tolist(), found.last_ticks.tolist()) == ([0], [90])
    assert not found.is_stuck.any()


def test_burns_divide_the_run_and_instants_inside_have_drifts_of_their_own() -> None:
    found = drift_starts(record(((17, 34), (70, 71))), 10)
    own = ~found.is_stuck
    assert list(zip(found.ticks[own], found.last_ticks[own], strict=True)) == [
        (0, 17), (20, 20), (30, 30), (34, 70), (71, 90)
    ]  # fmt: skip
    assert found.instants.tolist() == [0, 10, 17, 20, 30, 34, 40, 50, 60, 70, 71, 80, 90]
    starts = found.ticks[found.instant_drifts].tolist()
    assert starts == [0, 0, 0, 20, 30, 34, 34, 34, 34, 34, 71, 71, 71]


def test_the_thruster_is_stuck_open_after_each_burn() -> None:
    found = drift_starts(record(((17, 34), (70, 71))), 10)
    stuck = found.is_stuck
    assert list(zip(found.burn_ticks[stuck], found.ticks[stuck], strict=True)) == [(17, 34), (70, 71)]
    np.testing.assert_allclose(found.last_delta_v[stuck], 1e-3, rtol=1e-4)  # of differences in single precision
    np.testing.assert_array_equal(found.r_ST_N[:, 1, stuck], [[170.0, 700.0], [340.0, 710.0]])
    np.testing.assert_array_equal(found.v_ST_N[:, 1, stuck], [[-170.0, -700.0], [-340.0, -710.0]])


def test_a_run_ends_with_its_failure_and_an_unfinished_burn_has_no_end() -> None:
    found = drift_starts(record(((17, 34), (50, 90)), running=61), 20)
    assert found.instants.tolist() == [0, 17, 20, 34, 40, 50, 60]
    assert found.ticks[found.is_stuck].tolist() == [34]
    assert found.ticks[~found.is_stuck].tolist() == [0, 20, 34, 60]


def test_a_burn_from_the_first_tick_on_leaves_a_coast_of_one_instant() -> None:
    found = drift_starts(record(((0, 5),)), 50)
    own = ~found.is_stuck
    assert list(zip(found.ticks[own], found.last_ticks[own], strict=True)) == [(0, 0), (5, 50)]


def test_the_unsafe_share_weighs_each_instant_by_half_the_time_to_its_neighbours() -> None:
    found = drift_starts(record(((17, 34),)), 50)
    assert found.instants.tolist() == [0, 17, 34, 50]
    unsafe = np.array([False, True, True, False])
    every = np.ones_like(unsafe)
    assert found.unsafe_fraction(unsafe, every) == (17.0 + 16.5) / 50.0
    assert found.unsafe_fraction(~unsafe, every) == (8.5 + 8.0) / 50.0
    assert found.unsafe_fraction(unsafe, unsafe) == 1.0


def test_a_division_begins_a_coast_anew_and_is_an_instant_of_a_burn() -> None:
    found = drift_starts(record(((20, 30),)), 50, [10, 25, 60, TICKS])
    own = ~found.is_stuck
    assert list(zip(found.ticks[own], found.last_ticks[own], strict=True)) == [
        (0, 0), (10, 20), (25, 25), (30, 50), (60, 60)
    ]  # fmt: skip
    np.testing.assert_array_equal(found.r_ST_N[1, 0, own], [0.0, 10.0, 25.0, 30.0, 60.0])
