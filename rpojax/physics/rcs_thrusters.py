"""Small thrusters of a reaction control system (RCS): pulses of all of them as one force and torque."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.declared_numbers import number
from rpojax.core.numerics.gradient_safe import norm, normalize
from rpojax.core.numerics.runge_kutta import Method
from rpojax.core.pytree import pytree
from rpojax.physics.plume_impingement import Impingement
from rpojax.physics.thruster import pulse_factors
from rpojax.value_types import Direction

Scalar = Float[Array, ""]


@pytree
class RcsThruster:
    """Thruster fixed to the body that gives pulses, with its true values."""

    position: Array = number("point of application of the force from the centre of mass, B", unit="m", length=3)
    direction: Array = number(
        "direction of the force on the servicer, opposite the plume, B; any length", form=Direction
    )
    force: Array = number("nominal force, used by the flight software", unit="n", above=0.0)
    isp: Array = number("specific impulse", unit="s", above=0.0)
    minimum_on: Array = number("shortest pulse", unit="s", at_least=0.0, default=0.0)
    force_scale: Array = number("true over nominal force", above=0.0, default=1.0)
    misalignment: Array = number(
        "constant small rotation of the force, B", unit="deg", length=3, default=[0.0, 0.0, 0.0]
    )
    pulse_noise: Array = number("relative error of the force, new each tick, 1 sigma", at_least=0.0, default=0.0)


@pytree
class RcsState:
    """True thrusters of the reaction control system in a tick, along the first axis.

    Attributes:
        force_B: (n, 3) true force when open [N]
        position_B: (n, 3) where it acts, from the centre of mass [m]
        mass_flow: (n,) of propellant when open [kg/s]
        ratio: (n,) of the force over its nominal value [-]
        plume: load of each plume on the target when open, None where it has none
    """

    force_B: Array
    position_B: Array
    mass_flow: Array
    ratio: Array
    plume: Impingement | None = None


@pytree
class RcsThrust:
    """Force and torque of all thrusters at the nodes of an integration step.

    Attributes:
        force_B: (nodes, 3) [N]
        moment_B: (nodes, 3) about the centre of mass of the full servicer [N m]
        mass_flow: (nodes,) of propellant [kg/s]
        effort: (nodes,) sum of the sizes of the forces [N]
        plume: load of the plumes on the target, None where they have none
    """

    force_B: Array
    moment_B: Array
    mass_flow: Array
    effort: Array
    plume: Impingement | None = None


@pytree
class IsolationValves:
    """Valve before each thruster of the reaction control system, which shuts it off for good."""

    valve: Array = number(
        "from the command to the shut isolation valve; until then a thruster that is stuck open gives its full force",
        unit="s",
        at_least=0.0,
        default=0.5,
        key="isolation.valve_s",
    )


@pytree
class Leak:
    """Force that thrusters give without a command in a step, by one fault.

    Attributes:
        share: (n,) of the full force, 1 of a valve that is stuck open [-]
        begin: () from when on [s] from the begin of the step, before it or after it too
        end: (n,) until when: the fault is over, or the isolation valve is shut [s]
    """

    share: Array
    begin: Array
    end: Array


def stacked(thrusters: Mapping[str, RcsThruster]) -> RcsThruster:
    """The numbers of all thrusters along the first axis, in the order of their names."""
    # A mapping that passes through a compiled program comes out in that order.
    return jax.tree.map(lambda *each: jnp.stack(each), *(thrusters[name] for name in sorted(thrusters)))


def nominal_forces(thrusters: RcsThruster) -> Float[Array, "n 3"]:
    """Nominal force of each thruster in B [N]."""
    return thrusters.force[:, None] * jax.vmap(normalize)(thrusters.direction)


def nominal_flows(thrusters: RcsThruster) -> Float[Array, " n"]:
    """Nominal flow of propellant of each open thruster [kg/s]."""
    return thrusters.force / (thrusters.isp * STANDARD_GRAVITY)


def true_state(thrusters: RcsThruster, normals: Float[Array, " n"], left: Float[Array, " n"]) -> RcsState:
    """True thrusters of a tick, with errors from standard normal numbers and the share of force that is left [-]."""
    ratio = thrusters.force_scale * (1.0 + thrusters.pulse_noise * normals) * left
    turned = jax.vmap(lambda angle, force: quaternion.rotate(quaternion.exp(angle), force))
    return RcsState(
        force_B=ratio[:, None] * turned(thrusters.misalignment, nominal_forces(thrusters)),
        position_B=thrusters.position,
        mass_flow=jnp.abs(ratio) * nominal_flows(thrusters),
        ratio=ratio,
    )


def thrust_over_step(
    state: RcsState, on_time: Float[Array, " n"], method: Method, dt: float | Scalar, leaks: Sequence[Leak] = ()
) -> RcsThrust:
    """Thrust over a step of `dt` [s] at whose begin each thruster opens for its on-time [s], with exact impulses.

    What leaks adds to that as long as the thruster is not open by command.
    """

    def pulses(times: Float[Array, " n"]) -> Float[Array, "nodes n"]:
        return jax.vmap(lambda each: pulse_factors(each, method, dt), out_axes=1)(times)

    factors = pulses(on_time)
    for leak in leaks:
        begin = jnp.clip(jnp.maximum(leak.begin, on_time), 0.0, dt)
        factors = factors + leak.share[None, :] * (pulses(jnp.clip(leak.end, begin, dt)) - pulses(begin))

    def total(per_thruster: Float[Array, "n 3"]) -> Float[Array, "nodes 3"]:
        return jnp.sum(factors[:, :, None] * per_thruster[None], axis=1)

    def on_target(each: Impingement) -> Impingement:
        size = jnp.sum(factors * each.size[None], axis=1)
        return Impingement(force_N=total(each.force_N), torque_T=total(each.torque_T), size=size)

    return RcsThrust(
        force_B=total(state.force_B),
        moment_B=total(jnp.cross(state.position_B, state.force_B)),
        mass_flow=jnp.sum(factors * state.mass_flow[None], axis=1),
        effort=jnp.sum(factors * jax.vmap(norm)(state.force_B)[None], axis=1),
        plume=None if state.plume is None else on_target(state.plume),
    )
