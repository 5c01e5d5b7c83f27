"""Failing runs that were met: the most likely ones, as scenarios that any run command simulates again."""

import heapq
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints
from rpojax.analysis.reliability.rare_events.limit_state_calls import LimitFunction
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.scenario.dispersed_numbers import dispersion_keys, standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.parameter_keys import nominal_value, parse_key
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.simulation.noise import run_keys

MOST = 10
_RUN_ID_MASK = np.uint32(2**31 - 1)


@dataclass(frozen=True)
class FailingRun:
    """A failing run.

    Attributes:
        run_id: whose noise it has
        z: (k,) standard normal variables of its dispersions
        margin: to the failure
    """

    run_id: int
    z: np.ndarray
    margin: float

    @property
    def distance(self) -> float:
        """Distance of its dispersions from the median run [sigmas]."""
        return float(np.linalg.norm(self.z))


class FailureLog:
    """Keeps the most likely failures of all points that pass through.

    Attributes:
        own_noise: failures with the noise of a run number, which a run command can repeat
        any_noise: all failures
    """

    def __init__(self) -> None:
        self.own_noise: list[tuple[float, int, FailingRun]] = []
        self.any_noise: list[tuple[float, int, FailingRun]] = []
        self._count = itertools.count()

    def watched(self, function: LimitFunction) -> LimitFunction:
        """The function, whose failures are kept."""

        def margins(points: LatentPoints) -> np.ndarray:
            found = function(points)
            for row in np.flatnonzero(found <= 0.0):
                run = FailingRun(int(points.keys[row, 0] & _RUN_ID_MASK), points.x[row].copy(), float(found[row]))
                self._keep(self.any_noise, run)
                if not points.keys[row, 1:].any():
                    self._keep(self.own_noise, run)
            return found

        return margins

    def _keep(self, heap: list[tuple[float, int, FailingRun]], run: FailingRun) -> None:
        if any(entry[2].run_id == run.run_id and np.array_equal(entry[2].z, run.z) for entry in heap):
            return
        entry = (-run.distance, next(self._count), run)
        if len(heap) < MOST:
            heapq.heappush(heap, entry)
        else:
            heapq.heappushpop(heap, entry)

    @property
    def most_likely(self) -> list[FailingRun]:
        """Failures that can be repeated, the most likely dispersions first."""
        return sorted((entry[2] for entry in self.own_noise), key=lambda run: run.distance)

    @property
    def unrepeatable(self) -> list[FailingRun]:
        """Most likely failures whatever their noise."""
        return sorted((entry[2] for entry in self.any_noise), key=lambda run: run.distance)


def repeated_with_own_noise(log: FailureLog, margins: LimitFunction, rng: np.random.Generator, tries: int) -> int:
    """Simulates the dispersions of failures that cannot be repeated with the noise of new runs; the runs it took.

    Failures among them enter the log. `margins` are those of a function that the log watches.
    """
    starts = log.unrepeatable
    if len(log.own_noise) >= MOST or not starts:
        return 0
    x = np.stack([starts[number % len(starts)].z for number in range(tries)])
    keys = np.zeros((tries, 2), dtype=np.uint32)
    keys[:, 0] = rng.integers(1, 2**31, tries)
    margins(LatentPoints(x, keys))
    return tries


def values_of(space: StandardNormalSpace, seed: int, z: np.ndarray, run_id: int) -> dict[str, np.ndarray]:
    """Values of the dispersed keys, in their units, of a run with normal variables `z` (k,)."""
    key = run_keys(seed, np.array([run_id]))[0]
    values = jax.jit(space.values_at)(jnp.asarray(z), jnp.asarray(key))
    return {name: np.asarray(value) for name, value in values.items()}


def described(space: StandardNormalSpace, z: np.ndarray, values: dict[str, np.ndarray]) -> list[dict[str, Any]]:
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
    return sorted(entries, key=lambda each: -each["distance_sigmas"])


def write_scenarios(
    space: StandardNormalSpace, seed: int, runs: list[FailingRun], directory: Path
) -> list[dict[str, Any]]:
    """Writes a scenario with the dispersions of each run into a folder; entries with the command that simulates it."""
    import tomli_w

    entries = []
    for number, run in enumerate(runs, 1):
        values = values_of(space, seed, run.z, run.run_id)
        path = directory / "failing_runs" / f"{number:02d}.toml"
        fixed = standard_normal_space.with_fixed_values(space, values)
        # The folder is absolute, since the page and the files that show the command are read from anywhere.
        command = command_line(
            "run",
            path.absolute(),
            *("--seed", seed, "--run-id", run.run_id, "--out", f"{directory.name}_run_{number:02d}"),
            plugin=space.file.plugin,
        )
        write_atomically(path, (f"# {command}\n\n" + tomli_w.dumps(fixed.model_dump(mode="json"))).encode())
        entries.append(
            {
                "run_id": run.run_id,
                "distance_sigmas": run.distance,
                "margin": run.margin,
                "scenario": f"failing_runs/{path.name}",
                "command": command,
                "dispersions": described(space, run.z, values),
            }
        )
    return entries
