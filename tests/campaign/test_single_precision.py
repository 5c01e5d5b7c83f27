"""Campaigns in single precision agree with those in double precision, except for rounding."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.gradients.tuning import tune
from rpojax.campaign import single_run
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import single_precision


def mission(duration_s: float, kind: str, name: str = "inspection") -> ScenarioFile:
    """A shortened packaged mission in a given precision."""
    return scenario_loader.load(name, [f"duration_s={duration_s}", f"precision={kind}"])


@dataclass(frozen=True)
class Pair:
    """One metric of the same runs in both precisions, where it is defined."""

    name: str
    double: np.ndarray
    single: np.ndarray

    @property
    def half_interval(self) -> float:
        """Half width of the 95 % interval of the mean in double precision."""
        return 1.96 * float(np.std(self.double, ddof=1)) / np.sqrt(len(self.double))

    @property
    def mean_difference(self) -> float:
        """Absolute difference of the means."""
        return abs(float(np.mean(self.single) - np.mean(self.double)))


def simulate_both(duration_s: float, runs: int, name: str = "inspection") -> list[Pair]:
    """Metrics of the same runs; failures and undefined metrics must be the same in both precisions."""
    double, single = (tune.simulate_runs(mission(duration_s, kind, name), 5, runs) for kind in ("double", "single"))
    np.testing.assert_array_equal(single.failed, double.failed)
    pairs = []
    for metric, values in double.metrics.items():
        defined = np.isfinite(values)
        np.testing.assert_array_equal(np.isfinite(single.metrics[metric]), defined, err_msg=metric)
        if np.sum(defined) > 1:
            pairs.append(Pair(metric, values[defined].astype(float), single.metrics[metric][defined].astype(float)))
    return pairs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "duration_s"),
    [
        ("inspection", 6000.0),
        ("inspection_full", 2000.0),
        ("inspection_eclipse", 4000.0),
        ("inspection_faults", 2000.0),
    ],
)
def test_statistics_agree_with_those_in_double_precision_within_their_intervals(name: str, duration_s: float) -> None:
    pairs = simulate_both(duration_s, 128, name)
    assert len(pairs) > 20
    for pair in pairs:
        assert pair.mean_difference <= 0.2 * pair.half_interval + 1e-12, pair.name
        # The differences of single runs are far below the spread of the runs.
        assert np.median(np.abs(pair.single - pair.double)) <= 0.05 * np.std(pair.double) + 1e-12, pair.name


@pytest.mark.slow
def test_short_runs_agree_with_those_in_double_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    # One after the other: the program in double precision is that of other tests.
    monkeypatch.setattr(tune, "share_runs", lambda *_: (jax.devices()[:1], 1))
    pairs = {pair.name: pair for pair in simulate_both(200.0, 6)}
    for name in ("nav_relative_position_error_rms_m", "nav_servicer_position_error_rms_m", "formation_error_rms_m"):
        np.testing.assert_allclose(pairs[name].single, pairs[name].double, rtol=0.02, err_msg=name)
        assert np.any(pairs[name].single != pairs[name].double)


@pytest.mark.slow
def test_propellant_below_the_last_digit_of_the_mass_accumulates() -> None:
    masses = []
    for kind in ("double", "single"):
        engine = BatchEngine(mission(1000.0, kind), 2, jax.devices()[:1])
        prepared = engine.prepare(3, np.arange(2))
        masses.append([segment.channels["mass_kg"] for segment in engine.simulate(prepared)][-1][-1])
    used = prepared.drawn["servicer.mass_kg"] - masses[0]
    assert np.all(used > 1e-3)
    np.testing.assert_allclose(masses[1], masses[0], rtol=0.0, atol=4e-6)


def test_state_of_the_loop_is_in_single_precision() -> None:
    engine = BatchEngine(mission(200.0, "single"), 1, jax.devices()[:1])
    _, _, state = engine._preparation_trace.out_info
    dtypes = {leaf.dtype for leaf in jax.tree.leaves(state) if jnp.issubdtype(leaf.dtype, jnp.floating)}
    assert dtypes == {np.dtype(np.float32)}
    assert state.truth.orbit_low.shape == state.flight.orbit.servicer.orbit_low.shape == (2, 3, 1)


def test_rounded_state_and_low_order_part_add_up_to_the_state() -> None:
    _, _, state = single_run.initialise_run(mission(200.0, "double"))
    rounded = jax.jit(single_precision.round_state_to_single)(state)
    assert rounded.truth.orbit_low is not None
    total = rounded.truth.r_TN_N.astype(jnp.float64) + rounded.truth.orbit_low[0].astype(jnp.float64)
    np.testing.assert_allclose(total, state.truth.r_TN_N, rtol=0.0, atol=1e-8)
    np.testing.assert_array_equal(rounded.keys, state.keys)
    assert rounded.tick.dtype == state.tick.dtype


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("camera.model=rendered", "camera.model"),
        ("effects.integrator=rk8", "effects.integrator"),
        ("duration_s=100000", "duration_s"),
        ("rates.plant_hz=100", "rates.plant_hz"),
    ],
)
def test_unsupported_scenarios_are_refused(override: str, named: str) -> None:
    with pytest.raises(RpojaxError, match=rf"^{named}: found .* expected .*single"):
        scenario_loader.load("inspection", ["precision=single", override])


def test_single_run_is_refused_in_single_precision() -> None:
    with pytest.raises(RpojaxError, match=r"^precision: found 'single', expected 'double'"):
        single_run.simulate(mission(200.0, "single"))
