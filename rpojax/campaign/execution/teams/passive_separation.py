"""Passive safety between the servicers of a team: free drifts of each pair, one of them in place of the target.

Both drift on orbits so near to the target's that their relative motion follows the same equations.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import jax
import numpy as np

from rpojax.campaign.execution.passive_safety import PassiveSafety
from rpojax.core.pytree import replace
from rpojax.metrics import passive_safety as metrics
from rpojax.metrics import team
from rpojax.scenario.params import Params


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
    pairs = [
        passive_safety.evaluate(drawn[i], _relative_channels(records, i, j), _in_place_of_target(members[i]))[name]
        for i, j in combinations(range(len(members)), 2)
    ]
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


def _in_place_of_target(params: Params) -> Params:
    """Parameters with a target of a servicer's mass and surface, so that nothing drifts by a difference of these."""
    plant = params.plant
    target = replace(plant.target, mass=plant.servicer.mass)
    return jax.tree.map(
        np.asarray, replace(params, plant=replace(plant, target=target, target_surface=plant.servicer_surface))
    )
