"""Records of the members of a team."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params, build_params
from rpojax.simulation.team import member_axes


@pytest.fixture(scope="module")
def members() -> list[Params]:
    """Parameters of three servicers that differ in mass."""
    files = [scenario_loader.load("inspection", [f"servicer.mass_kg={mass}"]) for mass in (30.0, 31.0, 32.0)]
    return [build_params(file.model_dump(), 1024, 1024) for file in files]


def test_equal_leaves_are_shared_and_members_come_back(members: list[Params]) -> None:
    team = member_axes.stack_members(members)
    assert team.leaves.plant.servicer.mass.tolist() == [30.0, 31.0, 32.0]
    assert team.leaves.plant.servicer.inertia.shape == (3, 3)
    for number, expected in enumerate(members):
        jax.tree.map(np.testing.assert_array_equal, team.member(jnp.int32(number)), expected)


def test_values_are_common_or_of_each_member(members: list[Params]) -> None:
    values = {"servicer.mass_kg": jnp.array([1.0, 2.0, 3.0]), "target.mass_kg": jnp.array(50.0)}
    team = member_axes.with_values(member_axes.stack_members(members), values, {"target.mass_kg"})
    masses = team.each(lambda params, factor: factor * (params.plant.servicer.mass + params.plant.target.mass))
    np.testing.assert_allclose(masses(jnp.array([1.0, 1.0, 2.0])), [51.0, 52.0, 106.0])


def test_one_element_is_taken_and_put() -> None:
    leaf = jnp.array([[1.0, jnp.inf], [2.0, jnp.nan]])
    np.testing.assert_array_equal(member_axes.take(leaf, jnp.int32(0)), [1.0, 2.0])
    np.testing.assert_array_equal(member_axes.put(leaf, jnp.int32(1), jnp.array([5.0, 6.0])), [[1.0, 5.0], [2.0, 6.0]])
    assert member_axes.take(jnp.array([[True, False]]), jnp.int32(0)).tolist() == [True]
