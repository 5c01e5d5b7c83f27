"""Dispersed values of the servicers of a team: some keys have one value for all, others one for each."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Arrays, Values
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team import members
from rpojax.simulation.team.initial_team import member_key


def numbers_of_members(file: ScenarioFile) -> list[Arrays]:
    """Numbers from which the values of each servicer are drawn."""
    return [dispersed_values.draw_numbers(member) for member in members.member_files(file)]


def draw_of_members(
    file: ScenarioFile, run_key: Array, assigned: Values, numbers: Sequence[Arrays] | None = None
) -> Values:
    """Values of all dispersed keys of a run: those that all share, of others those of each in the last axis.

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
    """Values (runs, ...) of one servicer from those of the team, by key."""
    if not file.servicers:
        return dict(values)
    common = dispersion_keys.common_keys(file)
    return {key: value if key in common else value[..., number] for key, value in values.items()}
