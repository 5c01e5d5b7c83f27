"""Thrusters whose plume points at the target are left out near it, and take part again far off and after an abort."""

import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.errors import ScenarioError
from rpojax.flight.control import plume_rule, thruster_allocation
from rpojax.flight.control.plume_rule import PlumeRule
from tests.scenario_error_assertions import assert_one_line

DIRECTIONS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
"""Of the forces; the plume of the second and the fourth leaves forwards."""


def may_fire(distance: float, angle_deg: float, has_aborted: bool = False) -> list[bool]:
    wrench = thruster_allocation.wrench_matrix(np.full(4, 0.25), DIRECTIONS, np.array([[0.0, 0.0, 0.2]] * 4))
    layout = thruster_allocation.layout(wrench, np.full(4, 1e-3), np.full(4, 0.02))
    rule = PlumeRule(inhibit_within=jnp.asarray(20.0), inhibit_angle=jnp.asarray(np.radians(angle_deg)))
    ahead = jnp.array([distance, 0.0, 0.0])
    return plume_rule.may_fire(rule, layout, ahead, jnp.asarray(has_aborted)).tolist()


@pytest.mark.parametrize(
    ("distance", "angle_deg", "expected"),
    [
        (10.0, 30.0, [True, False, True, True]),
        (10.0, 44.0, [True, False, True, True]),
        (10.0, 46.0, [True, False, True, False]),
        (25.0, 46.0, [True, True, True, True]),
    ],
)
def test_plumes_within_the_angle_are_inhibited_near_the_target(
    distance: float, angle_deg: float, expected: list[bool]
) -> None:
    assert may_fire(distance, angle_deg) == expected


def test_after_an_abort_all_may_fire() -> None:
    assert may_fire(10.0, 46.0, has_aborted=True) == [True] * 4


def test_a_rule_that_leaves_no_way_to_brake_is_refused() -> None:
    assert rpojax.load("final_approach", ["plume.inhibit_within_m=20"]).plume.inhibit_angle_deg == 30.0
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("final_approach", ["plume.inhibit_within_m=20", "plume.inhibit_angle_deg=60"])
    assert_one_line(refused.value, "plume.inhibit_angle_deg", "without those whose plumes point")
