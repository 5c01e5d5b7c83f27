"""A synthetic linear covariance and Monte Carlo sample, for tests of their comparison and figures."""

import numpy as np

from rpojax.analysis.linear_covariance.covariance_propagation import LinearCovariance
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS
from rpojax.analysis.linear_covariance.monte_carlo_agreement import CHANNELS, MonteCarloSample

TIMES, RUNS = 40, 400


def synthetic_linear_covariance(scale: float = 1.0) -> tuple[LinearCovariance, MonteCarloSample]:
    """A linear covariance, and a sample with `scale` times its standard deviations."""
    rng = np.random.default_rng(0)
    count = max(part.stop for part in OUTPUTS.values())
    sigma = np.linspace(1.0, 2.0, count)
    time_s = np.arange(0.0, 10.0 * TIMES, 10.0)
    zeros = np.zeros((TIMES, count))
    linear = LinearCovariance(
        time_s=time_s,
        nominal=zeros,
        mean=zeros,
        covariance=np.tile(np.diag(sigma**2), (TIMES, 1, 1)),
        filter_sigma_H=np.ones((TIMES, 3)),
        box_fraction=np.ones(TIMES),
        sources=["one", "other"],
        left_out=[],
        share_time_s=time_s,
        shares=np.stack([np.tile(0.36 * sigma**2, (TIMES, 1)), np.tile(0.64 * sigma**2, (TIMES, 1))], axis=1),
        burn_probability=np.array([0.0, 0.5]),
        burn_size_m_s=np.array([0.0, 0.01]),
        compile_s=0.0,
        run_s=0.0,
        run_cpu_s=0.0,
    )
    values = {
        name: scale * sigma[OUTPUTS[name]] * rng.normal(size=(TIMES, RUNS, len(components)))
        for name, components in CHANNELS.items()
    }
    return linear, MonteCarloSample(time_s=time_s, values=values, runs=RUNS, failed=0, run_s=0.0)
