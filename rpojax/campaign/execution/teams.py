"""Teams of servicers in a batch of runs: their values, free drifts from each other, and what is stored of them.

Passive safety between the servicers of a team: free drifts of each pair, one of them in place of the target.

Both drift on orbits so near to the target's that their relative motion follows the same equations. Drag and sunlight
act on each by its own surface and its own mass.

Recording of teams: what is stored of all servicers together, and of each of them.

Arrays of the usual groups are those of the team; groups named `servicer_...` have the servicers in the second axis.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.core.pytree import replace
from rpojax.metrics import metric_catalogue, team
from rpojax.metrics import passive_safety as metrics
from rpojax.physics.plant_options import Effects
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Arrays, Values
from rpojax.scenario.params import Params
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


_OF_TARGET: Final = {
    "servicer.mass_kg": "target.mass_kg",
    "servicer_surface.area_m2": "target_surface.area_m2",
    "servicer_surface.drag_coefficient": "target_surface.drag_coefficient",
    "servicer_surface.pressure_coefficient": "target_surface.pressure_coefficient",
}
"""Key of the target by that of a servicer, of what the forces on their surfaces depend."""


def keys_of_target(effects: Effects, drawn: Mapping[str, Any]) -> dict[str, str]:
    """Keys of the target by those of the servicer that vary, and that act on free drifts."""
    acts = effects.drag or effects.solar_pressure
    return {own: other for own, other in _OF_TARGET.items() if acts and own in drawn}


def with_target(effects: Effects, drawn: Mapping[str, np.ndarray], nominal: Params) -> dict[str, np.ndarray]:
    """Dispersed values (runs, ...) with those of the target that a program for pairs of servicers needs, too."""
    missing = {own: key for own, key in keys_of_target(effects, drawn).items() if key not in drawn}
    return {**drawn, **{key: _value(drawn, nominal, key, np.shape(drawn[own])) for own, key in missing.items()}}


def least_separation(
    passive_safety: PassiveSafety,
    members: Sequence[Params],
    drawn: Sequence[Mapping[str, np.ndarray]],
    records: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Least distance of any two servicers in the free drifts of a run, over the longest horizon (runs,) [m].

    Args:
        passive_safety: of the batch
        members: nominal parameters of the servicers
        drawn: dispersed values (runs, ...) of each servicer, by key
        records: channels (ticks, ..., servicers, runs)
    """
    name = metrics.horizon_metric_name(passive_safety.file.safety.horizons[-1])
    effects = passive_safety.scenario.effects
    pairs = []
    for i, j in combinations(range(len(members)), 2):
        values = _in_place_of_target(effects, drawn[i], drawn[j], members[j])
        channels = _relative_channels(records, i, j)
        channels["mass_kg"] = _mass_against(effects, channels["mass_kg"], records["mass_kg"][..., j, :], [
            (drawn[number], members[number]) for number in (i, j)
        ])  # fmt: skip
        pairs.append(passive_safety.evaluate(values, channels, _with_target_of(members[i], members[j]))[name])
    return {team.PASSIVE_SEPARATION: np.min(pairs, axis=0)} if pairs else {}


def _relative_channels(records: Mapping[str, np.ndarray], i: int, j: int) -> dict[str, np.ndarray]:
    """Channels of servicer `i` relative to `j`; the burns of both divide the drifts."""
    both = {
        "r_ST_N": records["r_ST_N"][..., i, :].astype(float) - records["r_ST_N"][..., j, :],
        "v_ST_N": records["v_ST_N"][..., i, :].astype(float) - records["v_ST_N"][..., j, :],
        "delta_v_m_s": records["delta_v_m_s"][..., i, :].astype(float) + records["delta_v_m_s"][..., j, :],
        "mass_kg": records["mass_kg"][..., i, :],
        "running": records["running"][..., i, :] & records["running"][..., j, :],
    }
    return both | ({"phase": records["phase"][..., i, :]} if "phase" in records else {})


def _with_target_of(own: Params, other: Params) -> Params:
    """Parameters of a servicer with a target that has the mass and the surface of another servicer."""
    plant = own.plant
    target = replace(plant.target, mass=other.plant.servicer.mass)
    surface = other.plant.servicer_surface
    return jax.tree.map(np.asarray, replace(own, plant=replace(plant, target=target, target_surface=surface)))


def _in_place_of_target(
    effects: Effects, own: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], nominal: Params
) -> dict[str, np.ndarray]:
    """Dispersed values of a servicer with those of another one, of `nominal` parameters, for those of the target."""
    runs = {key: np.shape(values) for key, values in own.items()}
    shapes = {key: runs[twin] for twin, key in keys_of_target(effects, own).items()}
    shapes |= {key: runs[key] for key in _OF_TARGET.values() if key in own}
    twins = {key: twin for twin, key in _OF_TARGET.items()}
    return {**own, **{key: _value(other, nominal, twins[key], shape) for key, shape in shapes.items()}}


def _mass_against(
    effects: Effects,
    mass: np.ndarray,
    other_mass: np.ndarray,
    pair: Sequence[tuple[Mapping[str, np.ndarray], Params]],
) -> np.ndarray:
    """Mass (ticks, runs) [kg] of one servicer that makes up for what another one has burned since the start.

    The other one, which stands for the target, has the mass of its start in the program of a run. Drag on both differs
    as it should with this mass; without drag, sunlight does. Where the first has no surface, or the change would be
    as large as the mass itself, its own mass stays.
    """
    if not (effects.drag or effects.solar_pressure):
        return mass
    kind = "drag_coefficient" if effects.drag else "pressure_coefficient"
    runs = mass.shape[-1:]
    strength, other_strength = (
        _value(*each, f"servicer_surface.{kind}", runs) * _value(*each, "servicer_surface.area_m2", runs)
        for each in pair
    )
    ratio = np.divide(other_strength, strength, out=np.zeros(runs), where=strength > 0.0)
    at_start = _value(*pair[1], "servicer.mass_kg", runs)
    change = mass.astype(float) * ratio * (1.0 / at_start - 1.0 / other_mass)
    return np.where(change > -0.9, mass / (1.0 + np.maximum(change, -0.9)), mass)


def _value(drawn: Mapping[str, np.ndarray], nominal: Params, key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Value of a key in every run of that shape, the nominal one where it does not vary."""
    if key in drawn:
        return np.asarray(drawn[key])
    path, factor = parameters.leaf_path_and_factor(key)
    return np.broadcast_to(np.asarray(parameters.get_leaf(nominal, path), dtype=np.float64) / factor, shape)


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
