"""Reaction control system within a tick: true thrusters, their pulses and leaks in each step, and their watch."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import replace
from rpojax.flight.control import rcs_control, thruster_isolation
from rpojax.flight.control.thruster_isolation import Isolation
from rpojax.physics import equipment_faults, forces_and_torques, rcs_thrusters
from rpojax.physics.equipment_faults import Fault
from rpojax.physics.plant_state import PlantParams, Truth, propellant_used
from rpojax.physics.rcs_thrusters import Leak, RcsState, RcsThrust
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import chamber_pressure
from rpojax.simulation import command_delay
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.tick import Loop, Motion, Tick

Scalar = Float[Array, ""]


def has_propellant(params: Params, truth: Truth) -> Bool[Array, ""]:
    """Whether propellant is left."""
    return propellant_used(params.plant, truth) < params.limits.propellant


def true_thrusters(loop: Loop, truth: Truth, noise: TickNoise, time: Scalar) -> RcsState:
    """Thrusters of the reaction control system in the tick that begins at `time` [s], with their errors and faults."""
    scenario, plant_params = loop.scenario, loop.params.plant
    assert noise.thrusters is not None
    left = jnp.ones_like(noise.thrusters[: scenario.thrusters])
    if scenario.effects.faults:
        left = equipment_faults.rcs_fractions(plant_params.faults, time, scenario.thrusters)
    stacked = rcs_thrusters.stacked(plant_params.thrusters)
    true = rcs_thrusters.true_state(stacked, noise.thrusters[: scenario.thrusters], left)
    if not scenario.effects.plume:
        return true
    with jax.named_scope("plume"):
        load = forces_and_torques.plumes_on_target(scenario.effects, plant_params, truth, true, 0.5 * scenario.tick_s)
    return replace(true, plume=load)


def pulses(loop: Loop, tick: Tick, motion: Motion, offset: Scalar) -> tuple[RcsThrust, Motion, Float[Array, " n"]]:
    """Thrust of the next step, the motion with what flight software knows of it, and the on-times that valves get [s].

    The step begins `offset` [s] after the tick.
    """
    params, dt, believed, given = loop.params, loop.scenario.step_s, loop.params.flight.thrusters, tick.flight.rcs
    assert believed is not None
    assert given is not None
    assert motion.owed is not None
    fired = motion.fired
    assert fired is not None
    on_time, owed = rcs_control.pulses(believed, given, motion.owed, dt, motion.isolation)
    if motion.commands is not None:
        assert motion.commands.on_time is not None
        on_time, waiting = command_delay.exchanged(motion.commands.on_time, on_time)
        motion = replace(motion, commands=replace(motion.commands, on_time=waiting))
    if motion.isolation is not None:
        # Pulses that were on their way do not pass a valve that has shut meanwhile.
        is_shut = valve_shut_at(loop.scenario, params.plant, motion.isolation) <= tick.time + offset
        on_time = jnp.where(is_shut, 0.0, on_time)
    assert tick.thrusters is not None
    q_BN = motion.attitude.q_BN
    vehicle = rcs_control.with_propellant_used(params.flight.vehicle, given)
    expected_N = rcs_control.expected_delta_v(believed, vehicle, given, q_BN, on_time)
    is_fed = has_propellant(params, motion.truth)
    fed_time = jnp.where(is_fed, on_time, 0.0)
    leaks = _leaks(loop, tick, motion, offset, is_fed)
    thrust = rcs_thrusters.thrust_over_step(tick.thrusters, fed_time, loop.scenario.effects.integrator, dt, leaks)
    known = replace(motion, owed=owed, fired=fired + on_time, delta_v_N=motion.delta_v_N + expected_N)
    return thrust, known, on_time


def valve_shut_at(scenario: Scenario, plant_params: PlantParams, isolation: Isolation) -> Float[Array, " n"]:
    """When the isolation valve of each thruster is shut [s] from the start: the command is late as all are."""
    return isolation.shut_at + scenario.command_steps * scenario.step_s + plant_params.isolation.valve


def leak_end(scenario: Scenario, plant_params: PlantParams, fault: Fault, isolation: Isolation | None) -> Array:
    """When each thruster with a fault stops to give force without a command, () or (n,) [s] from the start."""
    over = fault.start + fault.duration
    return over if isolation is None else jnp.minimum(over, valve_shut_at(scenario, plant_params, isolation))


def stuck_open_time(scenario: Scenario, plant_params: PlantParams, isolation: Isolation, time: Scalar) -> Scalar:
    """For how long a thruster has been stuck open up to `time` [s], NaN before that and without such a fault.

    Of several faults it is the longest time.
    """

    def longest_of(fault: Fault) -> Scalar:
        stuck = equipment_faults.is_stuck_open(fault, len(isolation.shut_at))
        open_time = jnp.minimum(time, leak_end(scenario, plant_params, fault, isolation)) - fault.start
        return jnp.max(jnp.where(stuck, open_time, -1.0), axis=0)

    each = [longest_of(fault) for fault in equipment_faults.in_order(plant_params.faults)]
    longest = functools.reduce(jnp.maximum, each) if each else jnp.full_like(time, -1.0)
    return jnp.where(longest >= 0.0, longest, jnp.nan)


def _leaks(loop: Loop, tick: Tick, motion: Motion, offset: Scalar, is_fed: Bool[Array, ""]) -> list[Leak]:
    """What thrusters give without a command in the step that begins `offset` [s] after the tick, by each fault.

    Leaks of one thruster add up to its full force: a fault gives what those before it in the list leave.
    """
    plant_params, found = loop.params.plant, list[Leak]()
    taken: Array | None = None
    for fault in equipment_faults.in_order(plant_params.faults) if loop.scenario.effects.faults else ():
        # Times relative to the step, because in single precision times since the start are too coarse.
        begin = fault.start - tick.time - offset
        share = equipment_faults.leak_shares(fault, loop.scenario.thrusters)
        end = leak_end(loop.scenario, plant_params, fault, motion.isolation) - tick.time - offset
        leak = Leak(share=jnp.where(is_fed, share, 0.0), begin=begin, end=jnp.broadcast_to(end, share.shape))
        if taken is not None:
            leak = replace(leak, share=jnp.minimum(leak.share, 1.0 - taken))
        acting = jnp.where((leak.begin < loop.scenario.step_s) & (leak.end > 0.0), leak.share, 0.0)
        taken = acting if taken is None else taken + acting
        found.append(leak)
    return found


def watched(
    loop: Loop, tick: Tick, motion: Motion, on_time: Float[Array, " n"], offset: Scalar, normals: Float[Array, " n"]
) -> Motion:
    """Motion at the end of a step with what the pressures in the chambers tell of thrusters that should rest.

    Args:
        loop: closed loop of the run
        tick: after guidance
        motion: at the end of the step
        on_time: (n,) of the commanded pulses [s]
        offset: () begin of the step since that of the tick [s]
        normals: (n,) standard normal numbers of the sensors
    """
    params, dt, believed = loop.params, loop.scenario.step_s, loop.params.flight.thrusters
    assert believed is not None
    assert motion.isolation is not None
    assert motion.uncommanded is not None
    assert tick.thrusters is not None
    thrusters = tick.thrusters
    leaks = _leaks(loop, tick, motion, offset, has_propellant(params, motion.truth))
    at_end = [jnp.where((leak.begin < dt) & (leak.end > dt), leak.share * thrusters.ratio, 0.0) for leak in leaks]
    true = functools.reduce(jnp.add, at_end) if at_end else jnp.zeros_like(on_time)
    pressure = chamber_pressure.measure_at_rest(params.chamber_pressure, true, normals)
    isolation, opened = thruster_isolation.watch(
        params.flight.isolation, motion.isolation, pressure, on_time, dt, tick.time + offset + dt
    )
    assert tick.flight.rcs is not None
    vehicle = rcs_control.with_propellant_used(params.flight.vehicle, tick.flight.rcs)
    given_N = rcs_control.delta_v(believed, vehicle, motion.attitude.q_BN, opened.time)
    return replace(
        motion,
        isolation=isolation,
        uncommanded=jax.tree.map(jnp.add, motion.uncommanded, opened),
        delta_v_N=motion.delta_v_N + given_N,
    )
