"""Samples of one dispersion of each kind."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core import random_streams
from rpojax.dispersions.kinds.attitude import RandomAttitude
from rpojax.dispersions.kinds.choice import Choice
from rpojax.dispersions.kinds.direction import RandomDirection
from rpojax.dispersions.kinds.log_normal import LogNormal
from rpojax.dispersions.kinds.normal import Normal
from rpojax.dispersions.kinds.small_rotation import SmallRotation
from rpojax.dispersions.kinds.truncated_normal import TruncatedNormal
from rpojax.dispersions.kinds.uniform import Uniform
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.schema import ScenarioFile

RUNS = 4000
FIVE_SIGMA = 5.0 / np.sqrt(RUNS)
"""Five standard deviations of a mean of standard numbers; the seed is fixed."""
LAST_DIGITS = 1e-13
"""Programs may differ in fused multiply-add operations."""

ONE_OF_EACH = (
    Normal(key="initial.relative_position_m", kind="normal", sigma=[1.0, 2.0, 0.0]),
    TruncatedNormal(key="servicer.mass_kg", kind="truncated_normal", sigma=2.0, limit_sigmas=1.5),
    Uniform(key="orbit.true_anomaly_deg", kind="uniform", low=-30.0, high=90.0),
    LogNormal(key="gps.noise_m", kind="log_normal", sigma=0.4),
    Choice(key="target.tumble_rate_deg_s", kind="choice", values=[0.0, 1.0, 5.0]),
    RandomDirection(key="target.tumble_axis", kind="direction"),
    RandomAttitude(key="target.attitude", kind="attitude"),
    SmallRotation(key="camera.mounting", kind="small_rotation", sigma_deg=[1.0, 2.0, 3.0]),
)


def draw(file: ScenarioFile, run_ids: Sequence[int] | np.ndarray, seed: int = 3) -> dict[str, np.ndarray]:
    """Values of the runs `run_ids`."""

    def one(run_id: jax.Array) -> dispersed_values.Values:
        return dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(seed), run_id), {})

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(jnp.asarray(run_ids, dtype=jnp.int32)))
