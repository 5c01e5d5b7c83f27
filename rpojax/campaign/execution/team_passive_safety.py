"""Passive safety between the servicers of a team: free drifts of each pair, one of them in place of the target.

Both drift on orbits so near to the target's that their relative motion follows the same equations. Drag and sunlight
act on each by its own surface and its own mass.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Final

import jax
import numpy as np

from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.core.pytree import replace
from rpojax.metrics import passive_safety as metrics
from rpojax.metrics import team
from rpojax.physics.plant_options import Effects
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params

_OF_TARGET: Final = {
    "servicer.mass_kg": "target.mass_kg",
    "servicer_surface.area_m2": "target_surface.area_m2",
    "servicer_surface.drag_coefficient": "target_surface.drag_coefficient",
    "servicer_surface.pressure_coefficient": "target_surface.pressure_coefficient",
}
"""Key of the target by that of a servicer, for the numbers on which drag and sunlight depend."""
_OF_SERVICER: Final = {target: servicer for servicer, target in _OF_TARGET.items()}


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
        pair = [(drawn[number], members[number]) for number in (i, j)]
        channels["mass_kg"] = _mass_against(effects, channels["mass_kg"], records["mass_kg"][..., j, :], pair)
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
    shapes = {target: np.shape(own[servicer]) for servicer, target in keys_of_target(effects, own).items()}
    shapes |= {target: np.shape(own[target]) for target in _OF_SERVICER if target in own}
    return {**own, **{key: _value(other, nominal, _OF_SERVICER[key], shape) for key, shape in shapes.items()}}


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
    path, factor = parameters.leaf_path_and_factor(key, nominal)
    return np.broadcast_to(np.asarray(parameters.get_leaf(nominal, path), dtype=np.float64) / factor, shape)
