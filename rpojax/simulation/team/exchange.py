"""Exchange of messages in a tick of a team: what is measured for it, what arrives, and what is made of it."""

from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Bool

from rpojax.core import random_streams
from rpojax.core.frames import hill_frame
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import replace
from rpojax.core.random_streams import Stream
from rpojax.core.vectors import apply
from rpojax.flight import computer
from rpojax.flight.cooperation import sharing
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.team_records import TeamRecords, of_pairs
from rpojax.flight.cooperation.team_settings import Link, ServicerTuning
from rpojax.flight.decisions import phase_goal
from rpojax.flight.flight_records import FlightMemory
from rpojax.flight.guidance import line_of_sight_uncertainty
from rpojax.flight.navigation import believed_sensor, burn_execution_error, thrust_estimator
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.flight.team_guidance import coordination, intent
from rpojax.flight.team_guidance.coordination import Announcements
from rpojax.physics import equipment_faults, radio_link
from rpojax.scenario.params import Params
from rpojax.sensors import gps
from rpojax.sensors import link_range as link_range_sensor
from rpojax.sensors.gps import Gps
from rpojax.simulation.noise import INITIAL_TICK
from rpojax.simulation.state import State
from rpojax.simulation.team.member_axes import TeamParams
from rpojax.simulation.team.team_loop import TeamLoop
from rpojax.simulation.team.team_state import LinkState, TeamState
from rpojax.simulation.tick import Loop, Motion, Tick, tick_axes
from rpojax.simulation.tick_measurements import measure_position


def initial(loop: TeamLoop, servicers: State) -> TeamState:
    """State of a team whose servicers have just been handed over."""
    if loop.settings.link.sharing == "none":
        return TeamState(servicers=servicers)
    count = loop.settings.servicers
    normals = loop.params.each(lambda _, keys: _carrier_normals(keys, jnp.int32(INITIAL_TICK)))(servicers.keys)
    error = _carrier_receiver(loop.params.member(0)).bias_sigma * normals[:3]
    zero = jnp.zeros(count, dtype=servicers.truth.r_ST_N.dtype)
    records = TeamRecords(
        orbit=servicers.flight.orbit,
        gate=servicers.flight.gate,
        accepted=jnp.zeros(count, dtype=bool),
        box=_no_box(zero),
        gps=_no_position(servicers),
        q_KN=jnp.zeros((4, count), dtype=zero.dtype),
        running=jnp.ones(count, dtype=bool),
        ranges=jnp.zeros((count - 1, count), dtype=zero.dtype) if loop.settings.link.ranging else None,
    )
    memory = sharing.initial(_link(loop), _tuning(loop.params), records)
    links = LinkState(
        in_burst=jnp.zeros((count, count), dtype=bool),
        carrier_error_N=error,
        range_bias=_range_biases(loop, servicers) if loop.settings.link.ranging else None,
    )
    plans = None
    if loop.settings.coordinated:
        maps_directions = loop.scenario.mission.phasing == "viewpoints"
        plans = coordination.initial(loop.settings.link, zero[0], maps_directions)
    return TeamState(servicers=servicers, links=links, sharing=memory, coordination=plans)


def share(loop: TeamLoop, state: TeamState, ticks: Tick) -> tuple[Tick, TeamState]:
    """Ticks (..., N) with the estimates after the messages of the tick, and the state of the exchange."""
    if state.sharing is None or state.links is None:
        return ticks, state
    links, arrived = _pass_messages(loop, state.links, ticks)
    by_carrier = loop.settings.carrier_differences

    def brings(params: Params, tick: Tick, carrier_error_N: Array) -> TeamRecords:
        return _records(params, tick, carrier_error_N if by_carrier else None)

    records = loop.params.each(brings, (tick_axes(-1), -1))(ticks, links.carrier_error_N)
    records = replace(records, ranges=_ranges(loop, links, ticks))
    tuning = _tuning(loop.params)
    records, memory = sharing.share(_link(loop), tuning, records, state.sharing, arrived, _time(ticks))
    flight = replace(ticks.flight, orbit=records.orbit)
    ticks, state = replace(ticks, flight=flight), replace(state, links=links, sharing=memory)
    ticks = replace(ticks, confirmed=loop.params.each(_confirmed, (tick_axes(-1), -1))(ticks, memory.messages_used))
    return _coordinate(loop, state, ticks, arrived)


def _confirmed(params: Params, tick: Tick, messages_used: Bool[Array, " peers"]) -> Bool[Array, ""]:
    """Whether boxes of other servicers take the place of one of its own.

    Until the target is acquired, the estimate must also be within the servicer's frame: else its camera would not
    search.
    """
    sigmas, half_frame = params.flight.pointing.search_sigmas, tick.measurements.box.half_frame_tangent
    is_in_frame = line_of_sight_uncertainty.is_within_frame(tick.flight.orbit, sigmas, half_frame)
    return jnp.any(messages_used) & (tick.flight.pointing.acquisition.acquired | is_in_frame)


def _coordinate(
    loop: TeamLoop, state: TeamState, ticks: Tick, arrived: Bool[Array, "peers N"]
) -> tuple[Tick, TeamState]:
    """Ticks and state with what the servicers know of each other's plans and motion."""
    if state.coordination is None:
        return ticks, state
    assert state.sharing is not None
    announced = loop.params.each(partial(_announced, loop), (tick_axes(-1),))(ticks)
    tuning = loop.params.member(0).team
    known, memory = coordination.share(
        loop.settings.link, tuning, state.coordination, state.sharing, announced, arrived
    )
    return replace(ticks, peers=known), replace(state, coordination=memory)


def _announced(loop: TeamLoop, params: Params, tick: Tick) -> Announcements:
    """What a servicer brings to the coordination."""
    mission, own, orbit = loop.scenario.mission, tick.flight.mission, tick.flight.orbit
    assert own.team is not None
    assert tick.innovation is not None
    shift = jnp.zeros_like(tick.time) if own.team.shift is None else own.team.shift.wanted
    follows = own.phase < mission.hold
    relative, servicer = orbit.relative, orbit.servicer
    R_HN = hill_frame(servicer.r_SN_N + relative.r_TS_N, servicer.v_SN_N + relative.v_TS_N)[0]
    return Announcements(
        plans=intent.intent(tick.flight.plan, follows, shift, tick.innovation.sensors["box"].accepted, tick.time),
        slots=_slots(loop, params),
        place_H=-apply(R_HN, relative.r_TS_N),
        R_HN=R_HN,
        sun_H=apply(R_HN, gradient_safe.normalize(tick.sky.sun_N)),
    )


def _slots(loop: TeamLoop, params: Params) -> Array:
    """Phases (rows,) of a servicer's relative orbits by the plan [rad], 0 where a phase has another reference."""
    software = Loop(loop.scenario, params, loop.stages).software
    references = [phase_goal.reference_of(software, phase) for phase in loop.scenario.mission.phases]
    return jnp.stack([phase_goal.planned_phase(reference) for reference in references])


def predict(loop: TeamLoop, state: TeamState, ticks: Tick, motion: Motion, after: State) -> TeamState:
    """State of the team after a tick, with the servicers `after` it."""
    if state.sharing is None or state.links is None:
        return replace(state, servicers=after)

    def moved(params: Params, tick: Tick, after: FlightMemory, commanded_N: Array) -> TickMotion:
        tuning, thrust = params.flight.navigation, after.thrust_estimate
        planned = thrust.ratio * gradient_safe.norm(after.plan.delta_v_N)
        delta_v_N = thrust.ratio * commanded_N
        sigma = thrust_estimator.sigma_inflation(tuning, thrust) * burn_execution_error.new_sigma(tuning)
        return TickMotion(
            r_before_N=tick.flight.orbit.servicer.r_SN_N,
            r_after_N=after.orbit.servicer.r_SN_N,
            delta_v_N=delta_v_N,
            burn_covariance=burn_execution_error.burn_covariance(
                delta_v_N, planned, sigma, burn_execution_error.new_direction_sigma(tuning)
            ),
            reopened=tick.flight.reopened,
        )

    motions = loop.params.each(moved, (tick_axes(-1), -1, -1))(ticks, after.flight, motion.delta_v_N)
    target = after.flight.orbit.relative
    memory = sharing.predict(_link(loop), _tuning(loop.params), state.sharing, target, motions)
    number = ticks.state.tick + 1

    def advance(params: Params, keys: Array, error_N: Array) -> Array:
        normals = _carrier_normals(keys, number)[:3]
        return gps.advance_bias(_carrier_receiver(params), error_N, normals, loop.scenario.tick_s)

    error = loop.params.each(advance)(ticks.state.keys, state.links.carrier_error_N)
    links = replace(state.links, carrier_error_N=error)
    return replace(state, servicers=after, links=links, sharing=memory)


def _records(params: Params, tick: Tick, carrier_error_N: Array | None) -> TeamRecords:
    """What a servicer brings to the exchange, after its own navigation."""
    assert tick.innovation is not None
    memory, position = tick.flight, tick.measurements.gps
    if carrier_error_N is not None:
        normals = _carrier_normals(tick.state.keys, tick.state.tick)[3:]
        receiver = _carrier_receiver(params)
        position = measure_position(receiver, tick.state.truth, carrier_error_N, normals, tick.health)
    return TeamRecords(
        orbit=memory.orbit,
        gate=replace(memory.gate, recovered=_has_recovered(params, memory)),
        accepted=tick.innovation.sensors["box"].accepted,
        box=computer.filtered_box(
            params.flight, tick.state.flight, memory.attitude_variance, tick.measurements.box, tick.sky.sun_N
        ),
        gps=position,
        q_KN=computer.camera_attitude(params.flight.vehicle, memory.attitude.q_BN),
        running=jnp.isinf(tick.state.failed_at),
        rows=believed_sensor.rows_of(tick.innovation.sensors),
    )


def _has_recovered(params: Params, memory: FlightMemory) -> Bool[Array, ""]:
    """Whether rejected boxes, or measurements of an additional sensor, have widened the own estimate."""
    recovered = memory.gate.recovered
    for rejected_s in memory.rejected_s.values():
        recovered = recovered | computer.has_widened(params.flight, rejected_s)
    return recovered


def _pass_messages(loop: TeamLoop, links: LinkState, ticks: Tick) -> tuple[LinkState, Bool[Array, "peers N"]]:
    """Links after a tick, and which messages that are due arrive, of the peers of each servicer."""
    settings, count = loop.settings.link, loop.settings.servicers
    radio = loop.params.member(0).link
    time = _time(ticks)
    key = random_streams.fold_in(ticks.state.keys[Stream.LINK, :, 0], ticks.state.tick)
    uniforms = random_streams.uniform(key, 2 * count * count).reshape(2, count, count)
    in_burst = radio_link.advance_bursts(radio, links.in_burst, uniforms[0], loop.scenario.tick_s)
    due = (ticks.state.tick - settings.delay_ticks) % settings.period_ticks == 0
    linked = _pairs(settings.hears, count)
    works = jnp.isinf(ticks.state.failed_at) & _radio_works(loop, time)
    if settings.sharing == "central":
        arrives = jnp.ones((count, count), dtype=bool)
    else:
        arrives = radio_link.arrives(radio, in_burst, uniforms[1], time) & due
    arrived = of_pairs(arrives & linked & works[None, :] & works[:, None], settings.peers)
    return replace(links, in_burst=in_burst), arrived


def _range_biases(loop: TeamLoop, servicers: State) -> Array:
    """Biases (N, N) of the ranges over the links [m]."""
    link_range = loop.params.member(0).link_range
    return link_range_sensor.bias(link_range, _range_normals(servicers.keys, jnp.int32(INITIAL_TICK)))


def _ranges(loop: TeamLoop, links: LinkState, ticks: Tick) -> Array | None:
    """Ranges (peers, N) that each servicer measures to its peers over the links [m]."""
    if links.range_bias is None:
        return None
    normals = _range_normals(ticks.state.keys, ticks.state.tick)
    place_N = ticks.state.truth.r_ST_N
    ranges = link_range_sensor.measure(loop.params.member(0).link_range, place_N, links.range_bias, normals)
    return of_pairs(ranges, loop.settings.link.peers)


def _range_normals(keys: Array, number: Array) -> Array:
    """Standard normal numbers (N, N) of the ranges over the links at a tick."""
    count = keys.shape[-1]
    key = random_streams.fold_in(keys[Stream.LINK_RANGE, :, 0], number)
    return random_streams.normal(key, count * count).reshape(count, count)


def _radio_works(loop: TeamLoop, time: Array) -> Bool[Array, " N"]:
    """Whether the radio of each servicer works at `time` [s]."""
    if not loop.scenario.effects.faults:
        return jnp.ones(loop.settings.servicers, dtype=bool)
    return loop.params.each(lambda params: equipment_faults.radio_works(params.plant.faults, time))()


def _pairs(pairs: tuple[tuple[int, int], ...], count: int) -> Bool[Array, "N N"]:
    """Matrix of the (receiver, sender) pairs."""
    return jnp.array([[(i, j) in pairs for j in range(count)] for i in range(count)])


def _time(ticks: Tick) -> Array:
    """Time of the tick [s], the same for all servicers."""
    return ticks.time[0]


def _carrier_receiver(params: Params) -> Gps:
    """Errors of a receiver's position by carrier phase that are not common: half the variance of a difference."""
    differences = params.gps_differences
    return Gps(
        noise=differences.noise / jnp.sqrt(2.0),
        bias_sigma=differences.slow_error / jnp.sqrt(2.0),
        bias_time_constant=differences.slow_error_time_constant,
        common_share=jnp.zeros_like(differences.noise),
    )


def _carrier_normals(keys: Array, number: Array) -> Array:
    """Standard normal numbers (6,) of the carrier-phase position at a tick: of its slow error, and white ones."""
    return random_streams.normal(random_streams.fold_in(keys[Stream.GPS_DIFFERENCES], number), 6)


def _link(loop: TeamLoop) -> Link:
    return Link(loop.settings.link, loop.params.member(0).baseline, loop.scenario.tick_s)


def _tuning(params: TeamParams) -> ServicerTuning:
    return params.of_each(
        lambda member: ServicerTuning(filter=member.flight.navigation, focal_px=member.flight.vehicle.focal_px)
    )


def _no_position(servicers: State) -> GpsMeasurement:
    orbit = servicers.flight.orbit.servicer
    low = None if orbit.orbit_low is None else jnp.zeros_like(orbit.orbit_low[0])
    return GpsMeasurement(
        position_N=jnp.zeros_like(orbit.r_SN_N),
        position_low_N=low,
        present=jnp.zeros(orbit.r_SN_N.shape[-1], dtype=bool),
    )


def _no_box(zero: Array) -> BoxMeasurement:
    none, pair = jnp.zeros_like(zero, dtype=bool), jnp.stack([zero, zero])
    return BoxMeasurement(
        tangent=pair,
        log_size=zero,
        log_aspect=zero,
        side_px=zero,
        present=none,
        expected=none,
        truncated=none,
        half_frame_tangent=pair,
        attitude_variance_change=zero,
        interval=zero,
    )
