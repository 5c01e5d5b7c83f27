"""Points of the standard normal space of a scenario as its users see them: values, dispersions, and the command."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.parameter_keys import nominal_value, parse_key
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.simulation.noise import run_keys


def values_of(space: StandardNormalSpace, seed: int, z: np.ndarray, run_id: int) -> dict[str, np.ndarray]:
    """Values of the dispersed keys, in their units, of a run with normal variables `z` (k,)."""
    key = run_keys(seed, np.array([run_id]))[0]
    values = jax.jit(space.values_at)(jnp.asarray(z), jnp.asarray(key))
    return {name: np.asarray(value) for name, value in values.items()}


def dispersions_at(space: StandardNormalSpace, z: np.ndarray, values: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """Dispersions at a point, the farthest from their median first: sigmas, values in their units, nominal values."""
    entries = []
    for entry in space.mapped:
        rows = space.slices[entry.name]
        keys = list(dict.fromkeys(parameter.key for parameter in dispersion_keys.assigned_keys(entry)))
        entries.append(
            {
                "name": entry.name,
                "distance_sigmas": float(np.linalg.norm(z[rows])),
                "sigmas": dict(zip(space.labels[rows], z[rows].tolist(), strict=True)),
                "values": {key: values[key].tolist() for key in keys},
                "nominal": {key: nominal_value(space.file, parse_key(key)) for key in keys},
            }
        )
    return sorted(entries, key=lambda entry: -entry["distance_sigmas"])


def run_command(space: StandardNormalSpace, path: Path, seed: int, run_id: int, out: str) -> str:
    """Command that simulates a run of the scenario file `path`, absolute since the command is shown anywhere."""
    options = ("--seed", seed, "--run-id", run_id, "--out", out)
    return command_line("run", path.absolute(), *options, plugin=space.file.plugin)
