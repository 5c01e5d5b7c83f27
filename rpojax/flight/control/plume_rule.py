"""Which thrusters may fire near the target: none whose plume points at it, as the Low-Z mode of the Space Shuttle.

Near the target, thrusters whose exhaust leaves within an angle of the line to it are left out of the allocation. The
others do what they can. All of them count as at the centre of mass, and the target as a point: the angle has to cover
their places and the size of the target. After an abort all may fire: to get away counts more than a clean target.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.flight.control.thruster_allocation import ThrusterLayout


@pytree
class PlumeRule:
    """When the plumes of thrusters may not point at the target."""

    inhibit_within: Array = number(
        "range below which no thruster fires whose plume points at the target; 0 for no such rule",
        unit="m",
        at_least=0.0,
        default=0.0,
        key="plume.inhibit_within_m",
    )
    inhibit_angle: Array = number(
        "angle between the axis of a plume and the line to the target up to which it points at it",
        unit="deg",
        at_least=0.0,
        at_most=180.0,
        default=30.0,
        key="plume.inhibit_angle_deg",
    )


def may_fire(
    rule: PlumeRule, thrusters: ThrusterLayout, to_target_B: Float[Array, "3"], has_aborted: Bool[Array, ""]
) -> Bool[Array, " n"]:
    """Which thrusters may fire with the target at `to_target_B` [m] by the estimate, from the centre of mass."""
    force_B = thrusters.wrench[:3]
    distance = gradient_safe.norm(to_target_B)
    # A plume leaves against the force.
    along = -jnp.sum(force_B * to_target_B[:, None], axis=0)
    size = distance * jnp.sqrt(jnp.sum(force_B * force_B, axis=0))
    points_at_it = along >= jnp.cos(rule.inhibit_angle) * size
    return ~points_at_it | (distance >= rule.inhibit_within) | has_aborted
