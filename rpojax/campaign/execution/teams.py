"""Teams of servicers in a batch of runs: the values of each servicer, and what is stored of all of them.

Arrays of the usual groups are those of the team; groups named `servicer_...` have the servicers in the second axis.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.metrics import metric_catalogue
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Arrays, Values
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team import members
from rpojax.simulation.metrics import team_metrics
from rpojax.simulation.outcomes.judgement import JudgedRuns
from rpojax.simulation.team.initial_team import member_key

PREFIX = "servicer_"
"""Begin of the names of groups with an axis of servicers."""
_LEAST_TRACES = ("range_m",)
_GREATEST_TRACES = ("wheel_speed_fraction",)


def numbers_of_members(file: ScenarioFile) -> list[Arrays]:
    """Numbers from which the values of each servicer are drawn."""
    return [dispersed_values.draw_numbers(member) for member in members.member_files(file)]


def draw_of_members(
    file: ScenarioFile, run_key: Array, assigned: Values, numbers: Sequence[Arrays] | None = None
) -> Values:
    """Values of all dispersed keys of a run; a key that the servicers do not share has them in the last axis.

    `numbers` of each servicer are by default those of the scenario.
    """
    numbers = numbers_of_members(file) if numbers is None else numbers
    common = dispersion_keys.common_keys(file)
    drawn = [
        dispersed_values.draw(member, member_key(run_key, number), assigned, run_key, numbers[number])
        for number, member in enumerate(members.member_files(file))
    ]
    return {
        key: value if key in common else jnp.stack([own[key] for own in drawn], axis=-1)
        for key, value in drawn[0].items()
    }


def of_member(file: ScenarioFile, values: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Key -> values (runs, ...) of servicer `number`, from the values of the team."""
    if not file.servicers:
        return dict(values)
    common = dispersion_keys.common_keys(file)
    return {key: value if key in common else value[..., number] for key, value in values.items()}


def joined_arrays(
    servicers: Sequence[Mapping[str, np.ndarray]],
    metrics: Mapping[str, np.ndarray],
    coverage: Mapping[str, np.ndarray],
    judged: JudgedRuns,
    rows: slice,
) -> dict[str, np.ndarray]:
    """Arrays of a block of a team, `group/name` -> (runs, ...).

    Args:
        servicers: arrays of each of them
        metrics: of the team (runs,), which are not made of those of its servicers
        coverage: maps of the target's surface (all runs, facets), as all of them see it
        judged: how all runs ended
        rows: runs of the block
    """
    arrays: dict[str, np.ndarray] = {}
    for path in servicers[0]:
        group, _, name = path.partition("/")
        if group in ("coverage", "events"):
            continue
        each = np.stack([own[path] for own in servicers], axis=1)
        arrays[f"{PREFIX}{path}"] = each
        if group == "metrics":
            arrays[path] = team_metrics.joined(metric_catalogue.find(name), each)
        elif group == "traces":
            arrays[path] = _joined_trace(name, each)
    arrays |= {f"metrics/{name}": values for name, values in metrics.items()}
    frozen = judged.frozen[rows]
    for path in arrays:
        if path.startswith("metrics/") and "@" not in path:
            arrays[path] = np.where(frozen, np.nan, arrays[path])
    arrays |= {f"coverage/{name}": values[rows] for name, values in coverage.items()}
    arrays["status/failure"] = judged.codes[rows]
    arrays["status/failed_at_s"] = judged.since_s[rows]
    return arrays | {f"events/{name}": values for name, values in judged.events.stored(rows).items()}


def _joined_trace(name: str, each: np.ndarray) -> np.ndarray:
    """Trace of the team (runs, samples) from those of the servicers (runs, servicers, samples)."""
    if name in _LEAST_TRACES:
        return each.min(axis=1)
    return each.max(axis=1) if name in _GREATEST_TRACES else each.mean(axis=1)


def value_arrays(file: ScenarioFile, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values by group and key, those that the servicers have of their own as (runs, servicers, ...) in groups for that.

    Args:
        file: the scenario
        arrays: `group/key` -> (runs, ...), the servicers last
    """
    common = dispersion_keys.common_keys(file)
    return {
        path if path.partition("/")[2] in common else PREFIX + path: values
        if path.partition("/")[2] in common
        else np.moveaxis(values, -1, 1)
        for path, values in arrays.items()
    }


def joined_history(servicers: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """History of a team's run from those of its servicers: channels (ticks, servicers, ...)."""
    first = servicers[0]
    ticks = len(first["time_s"])
    joined = {}
    for name, values in first.items():
        axis = 1 if len(values) == ticks else 0
        joined[name] = values if name == "time_s" else np.stack([own[name] for own in servicers], axis=axis)
    return joined
