"""Gradients do not depend on how runs are divided among devices and batches, in either mode."""

import json
import os
import subprocess
import sys
from pathlib import Path

import fast_compile_flags
import jax
import jax.numpy as jnp
import linear_runs
import numpy as np
import pytest
from experiment_modules import EXPERIMENTS
from linear_runs import DIVISIONS, FAILED_RUN, OFFSETS, RUNS, START, TICKS, TRANSITION, UNDEFINED_RUN

import rpojax
from rpojax.simulation.noise import run_keys


def by_hand() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Metrics of the linear system, their derivatives (runs, metrics, 3), and the gradient of the objective."""
    # x = S (u + b) after all ticks, where S is the sum of the powers of A.
    total = sum(np.linalg.matrix_power(TRANSITION, power) for power in range(TICKS))
    keys = [jnp.asarray(key) for key in run_keys(0, np.arange(RUNS))]
    own, outputs = map(np.stack, zip(*(map(np.asarray, linear_runs.parts_of_run(key)) for key in keys), strict=True))
    metrics = np.einsum("rfi,ij,rj->rf", outputs, total, START + own) + OFFSETS
    jacobian = np.einsum("rfi,ij->rfj", outputs, total)
    completed = np.arange(RUNS) != FAILED_RUN
    both, relative, formation, pointing = np.moveaxis(jacobian, 1, 0)
    nees, nees_relative = metrics[:, 0], metrics[:, 1]
    consistency = 0.0
    for values, derivative in ((nees_relative, relative), (nees - nees_relative, both - relative)):
        # No run is beyond ten times the median: d log(m / 6)^2 = 2 log(m / 6) dm / m.
        assert np.all(values < 10.0 * np.median(values))
        mean = values[completed].mean()
        consistency = consistency + 2.0 * np.log(mean / 6.0) / mean * derivative[completed].mean(axis=0)
    # What the others contribute is constant, and counts in the mean.
    settled = completed & (np.arange(RUNS) != UNDEFINED_RUN)
    gradient = consistency + (formation / metrics[:, 2:3])[completed].sum(axis=0) / RUNS
    gradient = gradient + (pointing / metrics[:, 3:])[settled].sum(axis=0) / RUNS
    metrics[UNDEFINED_RUN, 3] = metrics[FAILED_RUN] = jacobian[FAILED_RUN] = np.nan
    return metrics, jacobian, gradient


def printed(script: str | Path, devices: int) -> str:
    """Output of a script in a process with some host devices."""
    cache: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    environment = dict(os.environ) | {"PYTHONPATH": str(Path(rpojax.__file__).parents[1])}
    environment["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={devices} {fast_compile_flags.FLAGS[0]}"
    environment |= {"JAX_COMPILATION_CACHE_DIR": cache} if cache else {"RPOJAX_CACHE": "off"}
    words = [sys.executable, str(script)]
    return subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout


def test_gradients_of_a_linear_system_do_not_depend_on_devices_and_batches() -> None:
    metrics, jacobian, gradient = by_hand()
    divided = json.loads(printed(linear_runs.__file__, 3))
    assert len(divided) == 2 * len(DIVISIONS)
    for found in divided:
        division = str(found["division"])
        np.testing.assert_allclose(found["metrics"], metrics, rtol=1e-12, err_msg=division)
        np.testing.assert_allclose(found["gradient"], gradient, rtol=1e-12, atol=1e-14, err_msg=division)
        np.testing.assert_allclose(found["of_metric"], jacobian[:, 0], rtol=1e-12, atol=1e-14, err_msg=division)
        assert found["excluded"] == 0


@pytest.mark.slow
def test_gradients_of_the_closed_loop_do_not_depend_on_devices_and_batches() -> None:
    # Three runs of 300 s: one batch on one device, and two batches on two devices, the last one padded.
    lines = [json.loads(line) for line in printed(EXPERIMENTS / "tuning" / "batches.py", 2).splitlines()]
    assert [list(line) for line in lines] == [["forward"], ["reverse"]]
    for line in lines:
        ((mode, differences),) = line.items()
        assert set(differences) == {"metrics", "runs", "gradient", "norm"}
        assert max(differences.values()) < 1e-8, mode
