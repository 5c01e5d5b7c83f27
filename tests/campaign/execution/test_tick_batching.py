"""A tick batched over the last axis is the tick batched by `jax.vmap`, with its derivatives; campaigns record which."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.campaign import run_and_resume
from rpojax.campaign.execution import campaign_engine
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.run_programs import tick_batching_mode
from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario

RUNS, TICKS = 3, 3
SAME = 1e-12
"""Relative rounding differences of two programs of the same loop after `TICKS`."""
SAME_DERIVATIVES = 1e-10
"""The same of derivatives: those of an update are differences of products up to a hundred times as large."""
SAME_SINGLE = 1e-6
"""The same of a channel in single precision, such as the score of a box: eight roundings."""


def directions(tree: Any) -> Any:
    """Random directions of change of all floating-point numbers, each in proportion to the largest of its leaf."""
    random = np.random.default_rng(0)

    def one(leaf: Any) -> np.ndarray:
        if not jnp.issubdtype(leaf.dtype, jnp.floating):
            return np.zeros(leaf.shape, jax.dtypes.float0)
        return np.asarray(random.normal(size=leaf.shape) * largest(leaf), leaf.dtype)

    return jax.tree.map(one, tree)


def largest(leaf: Any) -> float:
    """Magnitude of the largest finite number of a leaf."""
    return float(np.max(np.abs(np.where(np.isfinite(leaf), leaf, 0.0)), initial=0.0))


def magnitude(leaf_name: str, leaf: Any, state: Any, channels: Any, focal_px: float) -> float:
    """Magnitude of the numbers that a leaf is made of: its largest, or that of the numbers whose difference it is.

    A gyro bias is learnt from differences of rates of some 1 rad/s, a bearing bias from those of two boxes, the
    variance of the control effort from those of velocity covariances, its correction from those of velocities. Rates
    are turned by controllers that work with those of a low orbit, however slow the orbit is.
    """
    state = getattr(state, "servicers", state)
    terms = {
        "bias_B": 1.0,
        "omega_BN_B": 1e-3,
        "correction": largest(state.flight.orbit.relative.v_TS_N),
        "bearing_bias": largest(channels["expected_px"]) / focal_px,
        "variance": largest(state.flight.orbit.relative.covariance[3:6, 3:6]),
    }
    return max(largest(leaf), terms.get(leaf_name, 0.0))


def simulate(engine: BatchEngine, mode: BatchingMode, values: Any, state: Any) -> Any:
    """State and channels after some ticks, and their change along `directions` of values and state."""
    nominal, axes = jax.tree.map(jnp.asarray, engine._nominal), engine._run.state_axes

    def tick(values: Any, state: Any) -> Any:
        return engine._run.tick(nominal, values, state)

    batched = batching_mode.transform(mode)(tick, in_axes=(-1, axes), out_axes=(axes, -1))

    @jax.jit
    def advance(values: Any, state: Any, tangents: Any) -> Any:
        def ticks(values: Any, state: Any) -> Any:
            return jax.lax.scan(lambda carry, _: batched(values, carry), state, None, length=TICKS)

        return jax.jvp(ticks, (values, state), tangents)

    return jax.tree.map(np.asarray, advance(values, state, directions((values, state))))


def assert_both_ways_agree(
    name: str, overrides: Sequence[str] = (), same_derivatives: float = SAME_DERIVATIVES
) -> None:
    """Asserts that both ways of batching have the same state, channels and change along a direction.

    Floating-point numbers may differ by `SAME` of the largest number of their leaf, of all runs and components: a
    component that happens to be near zero is the sum of larger ones. Times, flags, decisions and keys are equal.
    """
    file = scenario_loader.load(name, overrides)
    engine = BatchEngine(file, RUNS, jax.devices()[:1])
    drawn, _, state = engine._compiled_preparation(*engine._preparation_inputs(0, np.arange(RUNS)))
    values = {key: jnp.moveaxis(value, 0, -1) for key, value in drawn.items()}
    ours, theirs = (simulate(engine, mode, values, state) for mode in ("last_axis", "jax"))
    after = ours[0][0]
    assert np.all(getattr(after, "servicers", after).tick == TICKS)
    focal_px = float(engine._nominal.flight.vehicle.focal_px)
    for (path, found), expected in zip(jax.tree.leaves_with_path(ours), jax.tree.leaves(theirs), strict=True):
        leaf = jax.tree_util.keystr(path)
        assert (found.shape, found.dtype) == (expected.shape, expected.dtype), leaf
        if not jnp.issubdtype(found.dtype, jnp.floating):
            assert found.dtype == jax.dtypes.float0 or np.array_equal(found, expected), leaf
            continue
        scale = magnitude(getattr(path[-1], "name", ""), expected, *theirs[path[0].idx], focal_px)
        of_number = same_derivatives if path[0].idx else SAME
        same = of_number if found.dtype == np.float64 else SAME_SINGLE
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=same * scale, err_msg=leaf)


@pytest.mark.slow
@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_a_batched_tick_is_that_of_vmap_with_its_derivatives(name: str) -> None:
    assert_both_ways_agree(name)


@pytest.mark.slow
def test_a_batched_tick_with_the_statistical_camera_is_that_of_vmap() -> None:
    """Its derivatives pass through single precision. Rendered cameras are batched by `jax.vmap` alone, see below."""
    assert_both_ways_agree("inspection", ["camera.model=statistical"], SAME_SINGLE)


def test_an_engine_batches_as_the_environment_says(mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    assert BatchEngine(mission, 1).batching == "last_axis"
    monkeypatch.setenv(batching_mode.VARIABLE, "jax")
    assert BatchEngine(mission, 1).batching == "jax"
    assert BatchEngine(mission, 1, batching="last_axis").batching == "last_axis"


def test_rendered_cameras_are_always_batched_by_jax(inspection: Scenario) -> None:
    assert tick_batching_mode(inspection, "last_axis") == "last_axis"
    assert tick_batching_mode(replace(inspection, camera_model="rendered"), "last_axis") == "jax"


def test_a_campaign_records_its_batching_and_goes_on_with_it(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_and_resume, "simulate_missing_blocks", lambda *_: None)
    monkeypatch.setenv(batching_mode.VARIABLE, "jax")
    campaign = run_and_resume.run_campaign(mission, 1, tmp_path / "runs", progress=False)
    assert json.loads((tmp_path / "runs" / "campaign.json").read_text())["batching"] == "jax"
    monkeypatch.delenv(batching_mode.VARIABLE)
    configuration = campaign.configuration
    assert campaign_engine.recreate_engine(configuration, jax.devices()[:1]).batching == "jax"
    earlier = replace(configuration, batching=None)
    assert campaign_engine.recreate_engine(earlier, jax.devices()[:1]).batching == "last_axis"
    with pytest.raises(RpojaxError, match="batching: found 'other', expected one of last_axis, jax"):
        campaign_engine.recreate_engine(replace(configuration, batching="other"), jax.devices()[:1])
