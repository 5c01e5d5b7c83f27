"""Kernels take their dtype from their arguments, so that the loop runs in either precision."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import pytest

import rpojax
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.simulation import single_precision
from rpojax.vision import pinhole

PACKAGE = Path(rpojax.__file__).parent
KERNELS = ("core", "physics", "flight", "sensors", "vision", "simulation")
EXCEPTIONS = {
    **dict.fromkeys(
        (
            "flight/guidance/burn_schedule.py",
            "flight/guidance/target_acquisition.py",
            "flight/navigation/box_measurement/outlier_gate.py",
            "flight/navigation_health.py",
            "physics/equipment_faults.py",
            "simulation/metrics/running_metrics.py",
        ),
        "an initial value, which has no arguments; a run is initialised in double precision and rounded",
    ),
    "core/random_streams.py": "drawn numbers, which depend on keys alone",
    "simulation/metrics/facet_inspection.py": "recorded channels, in single precision, after the simulation",
    "simulation/step_stages.py": "times of the plant steps of a tick, which depend on the scenario alone",
}
"""File -> why it asks for a dtype itself."""


def test_kernels_ask_for_no_dtype_of_their_own() -> None:
    found = {
        str(path.relative_to(PACKAGE))
        for folder in KERNELS
        for path in (PACKAGE / folder).rglob("*.py")
        if re.search(r"jnp\.float64", path.read_text())
    }
    assert found == set(EXCEPTIONS)


def assert_single(function: Callable[..., Any], *arguments: Any) -> None:
    """Asserts that single-precision arguments give no double while float64 is enabled."""
    trace = jax.jit(function).trace(*single_precision.round_to_single(arguments))
    assert "f64" not in str(trace.jaxpr)
    assert "f32" in str(trace.jaxpr)


def test_kernels_keep_single_precision_while_double_is_enabled(inspection_params: Params) -> None:
    flight, x = inspection_params.flight, jnp.asarray(0.2)
    assert_single(lambda angle: pinhole.pinhole_intrinsics(angle, 128, 96), x)
    assert_single(lambda formation, n: lqr_gain(formation, n, 200.0), flight.formation, x)


@pytest.mark.traces
@pytest.mark.parametrize("camera", ["geometric", "statistical"])
def test_loop_traced_in_single_precision_has_no_double_in_it(camera: str) -> None:
    file = scenario_loader.load("inspection_full", ["duration_s=200", "precision=single", f'camera.model="{camera}"'])
    (trace,) = BatchEngine(file, 2, jax.devices()[:1])._loop_traces.traces.values()
    assert "f32" in str(trace.jaxpr)
    assert "f64" not in str(trace.jaxpr)
    floating = {each.dtype for each in jax.tree.leaves(trace.out_info) if jnp.issubdtype(each.dtype, jnp.floating)}
    assert floating == {jnp.dtype(jnp.float32)}
