"""The orbit filter of the benchmark works on its synthetic measurements, and its updates are counted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.benchmark import filter_speed, synthetic_filter_inputs
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.scenario.schema import ScenarioFile


def test_filter_estimates_converge_to_the_truth(inspection_file: ScenarioFile) -> None:
    scenario, flight, start = synthetic_filter_inputs.nominal_setup(inspection_file)
    noise = jnp.asarray(np.random.default_rng(1).standard_normal((30, synthetic_filter_inputs.NOISES_PER_UPDATE, 3)))
    end, inputs = synthetic_filter_inputs.simulate_measurements(scenario, flight, start, noise)
    estimate, gate = filter_speed.broadcast((start, outlier_gate.initial()), 3)
    found = filter_speed.run_filter(scenario, flight, estimate, gate, inputs)
    error = np.asarray(found.relative.r_TS_N - end.relative.r_TS_N[:, None])
    sigma = np.sqrt(np.asarray(found.relative.covariance)[range(3), range(3)])
    assert np.all(np.abs(error) < 4.0 * sigma)
    # Boxes and GPS fixes have been used: both uncertainties are much smaller than at the start.
    assert np.all(sigma[1:].min(axis=0) < 0.5 * np.sqrt(np.asarray(start.relative.covariance)[0, 0]))
    assert np.all(np.asarray(found.servicer.covariance)[0, 0] < 0.5 * np.asarray(start.servicer.covariance)[0, 0])


@pytest.mark.slow
def test_updates_are_counted_over_all_devices(inspection_file: ScenarioFile) -> None:
    found = filter_speed.measure_batch(inspection_file, 2, updates=3)
    assert found.batch == 2 * len(jax.devices())
    assert found.us_per_update == pytest.approx(1e6 * found.run_s / (3 * found.batch))
