"""Prediction of both filters over a tick, with what flight software knows of its motion: burns, pulses, pressures."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control import rcs_control
from rpojax.flight.control.rcs_control import RcsCommand
from rpojax.flight.control.thruster_isolation import OpenTime
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.navigation import (
    attitude_ekf,
    differential_drag,
    lasting_error_effects,
    retrodiction,
    thrust_estimator,
)
from rpojax.flight.navigation.lasting_error_effects import LastingEffects

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def expected_delta_v(
    params: FlightParams, memory: FlightMemory, ignition: Scalar, cutoff: Scalar, dt: float | Scalar
) -> Vector:
    """Velocity change in N [m/s] that flight software expects over the next `dt` [s].

    The valve is commanded open from `ignition` to `cutoff`, both in [s] from now.
    """
    on = jnp.clip(dt, ignition, cutoff) - jnp.clip(0.0, ignition, cutoff)
    # The derivative of a tie is split between two steps; that of an empty burn must not count.
    on = jnp.where(cutoff > ignition, on, 0.0)
    direction_N = quaternion.rotate(quaternion.conjugate(memory.attitude.q_BN), params.vehicle.thrust_direction)
    return on * params.vehicle.thrust / params.vehicle.mass * direction_N


@pytree
class MotionOnBoard:
    """What the flight software knows of its motion over a tick.

    Attributes:
        q_BN_before: (4,) estimated attitude at the beginning
        delta_v_N: (3,) expected velocity change [m/s]
        fired: (n,) on-time of each thruster of the reaction control system [s], None without one
        pressures: (n,) chamber pressure of those that fired over its nominal value, None without sensors
        uncommanded: for how long each was open without a command, whose effect `delta_v_N` has; None where such
            thrusters are not watched
        thrust_ratio: () chamber pressure over its nominal value while the valve was open, None without a sensor: then
            the thrust is its nominal one
        third_body_acceleration_N: (3,) by Sun and Moon, zero where they are not modelled [m/s^2]
        sun_N: (3,) of the Sun from the Earth [m]
    """

    q_BN_before: Array
    delta_v_N: Array
    thrust_ratio: Array | None
    third_body_acceleration_N: Array
    sun_N: Array
    fired: Array | None = None
    pressures: Array | None = None
    uncommanded: OpenTime | None = None


def predict(software: FlightSoftware, memory: FlightMemory, motion: MotionOnBoard, end: Scalar) -> FlightMemory:
    """Memory with both filters propagated over the tick up to `end` [s]; a burn without thrust marks its thruster."""
    params, dt, delta_v_N = software.params, software.tick_s, motion.delta_v_N
    if memory.rcs is not None and motion.pressures is not None:
        memory, delta_v_N = _by_pressures(params, memory, motion)
    burning, burn_delta_v = jnp.sum(delta_v_N * delta_v_N, axis=0) > 0.0, gradient_safe.norm(memory.plan.delta_v_N)
    acts = None if memory.rcs is None else _pulses_act(memory.rcs, motion)
    if memory.rcs is not None and acts is not None:
        # Each tick of pulses is a burn of its own, and no sign of the one thruster.
        burning &= ~acts
        assert params.thrusters is not None
        size = rcs_control.burn_size(
            params.thrusters, params.vehicle, memory.rcs, motion.uncommanded, delta_v_N, params.navigation, dt
        )
        burn_delta_v = jnp.where(acts, size, burn_delta_v)
    thrust_estimate = memory.thrust_estimate
    if motion.thrust_ratio is not None:
        estimated = thrust_estimator.update(params.navigation, thrust_estimate, motion.thrust_ratio, dt)
        thrust_estimate = select(burning, estimated, thrust_estimate)
    ratio, inflation = thrust_estimate.ratio, thrust_estimator.sigma_inflation(params.navigation, thrust_estimate)
    if acts is not None:
        # What the one thruster gives says nothing of the others.
        ratio, inflation = jnp.where(acts, 1.0, ratio), jnp.where(acts, 1.0, inflation)
    orbit, own = software.stages.call_with_memory(
        "orbit_predict",
        memory.own,
        tuning=params.navigation,
        zonal_degree=software.filter.zonal_degree,
        estimate=memory.orbit,
        delta_v_N=ratio * delta_v_N,
        burn_delta_v=ratio * burn_delta_v,
        burn_sigma_inflation=inflation,
        third_body_acceleration_N=motion.third_body_acceleration_N,
        lasting=_lasting_effects(params, memory, motion, acts),
        time=end - dt,
        dt=dt,
    )
    history = memory.history
    if history is not None:
        history = retrodiction.remember(history, motion.q_BN_before, ratio * delta_v_N)
    rcs = memory.rcs
    if rcs is not None:
        assert params.thrusters is not None
        assert motion.fired is not None
        rcs = rcs_control.after_pulses(params.thrusters, rcs, motion.fired)
    return replace(
        memory,
        history=history,
        rcs=rcs,
        thrust_estimate=thrust_estimate,
        thruster_failed_at=jnp.where(
            burning & (thrust_estimate.ratio < _FAILED_THRUST_RATIO), end, memory.thruster_failed_at
        ),
        orbit=orbit,
        own=own,
        attitude=attitude_ekf.predict_covariance(params.attitude_filter, memory.attitude, motion.q_BN_before, dt),
    )


def _pulses_act(rcs: RcsCommand, motion: MotionOnBoard) -> Bool[Array, ""]:
    """Whether the velocity change of a tick is that of small thrusters, late and uncommanded pulses included."""
    assert motion.fired is not None
    acts = rcs.acts | jnp.any(motion.fired > 0.0, axis=0)
    return acts if motion.uncommanded is None else acts | jnp.any(motion.uncommanded.time > 0.0, axis=0)


def _by_pressures(params: FlightParams, memory: FlightMemory, motion: MotionOnBoard) -> tuple[FlightMemory, Vector]:
    """Memory that knows what each thruster gave, and the velocity change of the tick by it [m/s]."""
    assert memory.rcs is not None
    assert params.thrusters is not None
    assert motion.pressures is not None
    assert motion.fired is not None
    rcs, fired = rcs_control.learn_ratios(memory.rcs, motion.pressures, motion.fired), motion.fired
    vehicle = rcs_control.with_propellant_used(params.vehicle, rcs)
    before, after = (
        rcs_control.expected_delta_v(params.thrusters, vehicle, each, memory.attitude.q_BN, fired)
        for each in (memory.rcs, rcs)
    )
    return replace(memory, rcs=rcs_control.shut_off(rcs)), motion.delta_v_N + after - before


def _lasting_effects(
    params: FlightParams, memory: FlightMemory, motion: MotionOnBoard, acts: Bool[Array, ""] | None
) -> LastingEffects:
    """Effect of lasting errors over a tick with that `motion`; `acts` says that it is that of small thrusters."""
    servicer = memory.orbit.servicer
    axes_N = lasting_error_effects.thrust_axes(motion.q_BN_before, params.vehicle.thrust_direction)
    if acts is not None:
        # Pulses of several thrusters have no common direction that lasts.
        axes_N = jnp.where(acts, 0.0, axes_N)
    return LastingEffects(
        thrust_axes_N=axes_N,
        ballistic_N=differential_drag.ballistic_acceleration(
            params.atmosphere, servicer.r_SN_N, servicer.v_SN_N, motion.sun_N
        ),
    )


_FAILED_THRUST_RATIO = 0.3
"""Ratio of thrust to its nominal value below which the thruster counts as failed. A choice: one of half its force flies
on, and no thrust is ten sigma of the chamber pressure of `inspection` away."""
