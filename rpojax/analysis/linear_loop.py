"""The closed loop along its nominal run, and its derivative at every tick, compiled once for one burn period."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis import linear_sources, outlines
from rpojax.analysis.linear_sources import TickInputs
from rpojax.analysis.linear_state import Layout
from rpojax.analysis.outlines import Tumble
from rpojax.core.frames import apply, hill_frame
from rpojax.core.pytree import pytree
from rpojax.core.pytree import replace as put_in
from rpojax.flight import burn_plan, computer
from rpojax.flight.computer import FlightMemory, Stages
from rpojax.simulation import closed_loop, telemetry
from rpojax.simulation.closed_loop import State, Telemetry
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.params import Params
from rpojax.simulation.scenario import Scenario

OUTPUTS = {
    "rho_H": slice(0, 3),
    "rho_dot_H": slice(3, 6),
    "relative_error_H": slice(6, 9),
    "relative_rate_error_H": slice(9, 12),
    "servicer_error_H": slice(12, 15),
    "delta_v_m_s": slice(15, 16),
    "law_H": slice(16, 19),
}
"""What is looked at on every tick, and where it stands: [m], [m/s], in the true Hill frame of the run.

`law_H` is what the control law would ask for, before the conditions on a burn.
"""


@pytree
class Moment:
    """The nominal run at the beginning of a tick.

    Attributes:
        state: before the tick
        drawn: random numbers of the tick
        edges: (members, 4) deviations of the targets' outlines [px]
        outputs: (19,) as `OUTPUTS`
        sigma_H: (3,) of the relative position as the filter sees it, in H [m]
        seen: () bool, the filter used a box
        memory: flight software's memory with which a burn would be decided
    """

    state: State
    drawn: TickNoise
    edges: Array
    outputs: Array
    sigma_H: Array
    seen: Array
    memory: FlightMemory


@dataclass(frozen=True)
class Loop:
    """A scenario's loop about the mean of its dispersions; box edges are in pixels, not in sigmas.

    Attributes:
        scenario: static settings
        params: mean numbers, the camera's edge noise one pixel
        layout: the vector of deviations
        stages: of the flight software
    """

    scenario: Scenario
    params: Params
    layout: Layout
    stages: Stages

    @property
    def inputs(self) -> TickInputs:
        """The random numbers of a tick as a vector."""
        return TickInputs(self.scenario.substeps)

    def _drawn(self, state: State, tumble: Tumble, seen: Array) -> tuple[TickNoise, outlines.Outlines]:
        """A tick's numbers with which the box is the mean one of all targets."""
        shown = outlines.look(self.scenario, self.params, tumble, state.truth)
        own = outlines.outline(self.scenario, self.params, state.truth.q_TN, state.truth)
        return linear_sources.still(self.scenario.substeps, shown.mean - own, seen), shown

    def fly(self, state: State, tumble: Tumble, seen: Array) -> tuple[State, Tumble, Moment]:
        """The nominal run over as many ticks as `seen` (ticks,) has flags, which allow a box each."""

        def one(carry: tuple[State, Tumble], seen: Array) -> tuple[tuple[State, Tumble], Moment]:
            state, tumble = carry
            drawn, shown = self._drawn(state, tumble, seen)
            after, found = closed_loop.tick(self.stages, self.scenario, self.params, state, drawn)
            sigma_H = telemetry.observe(self.scenario, self.params, found)["relative_sigma_H"]
            moment = Moment(
                state=state,
                drawn=drawn,
                edges=shown.deviations,
                outputs=self._outputs(self.params, found),
                sigma_H=sigma_H,
                seen=found.innovation.accepted,
                # Guidance goes on after the decision; what it remembered before counts.
                memory=put_in(found.flight, pointing=state.flight.pointing),
            )
            turned = outlines.advance(self.scenario, self.params, tumble, state.truth.r_TN_N)
            return (after, turned), moment

        (state, tumble), moments = jax.lax.scan(one, (state, tumble), seen)
        return state, tumble, moments

    def derive(self, states: State, drawn: TickNoise) -> Array:
        """Derivatives (ticks, size + 19, size + inputs) of the next vector and the outputs, for each tick."""
        size, inputs = self.layout.size, self.inputs

        def one(moment: tuple[State, TickNoise]) -> Array:
            state, drawn = moment

            def step(both: Array) -> Array:
                moved, params = self.layout.unpack(both[:size], state, self.params)
                after, found = closed_loop.tick(
                    self.stages, self.scenario, params, moved, inputs.noise(both[size:], drawn)
                )
                return jnp.concatenate([self.layout.pack(after, params), self._outputs(params, found)])

            return jax.jacfwd(step)(self._point(state))

        return jax.lax.map(one, (states, drawn))

    def _point(self, state: State) -> Array:
        return jnp.concatenate([self.layout.pack(state, self.params), jnp.zeros(self.inputs.size)])

    def decide(self, memory: FlightMemory, tick: Array, laws: Array) -> tuple[Array, Array]:
        """Burns (samples, 3) [m/s] in N that flight software makes of outputs (samples, 3) of its control law.

        Also from when to when (samples, 2) [s] it then looks away.
        """
        time = tick.astype(jnp.float64) * self.scenario.tick_s
        sky = closed_loop.sky_at(self.scenario, time)

        def one(law: Array) -> tuple[Array, Array]:
            stages = replace(self.stages, formation_law=lambda gain, deviation: law)
            plan = computer.plan_burn(stages, self.params.flight, memory, sky.sun_N, time).plan
            turn = plan.ignition - plan.turn_start
            return plan.delta_v_N, jnp.stack([plan.turn_start, plan.cutoff + turn])

        return jax.vmap(one)(laws)

    def _outputs(self, params: Params, found: Telemetry) -> Array:
        memory = found.flight
        deviation, _ = burn_plan.deviation_at_burn(params.flight.formation, memory.station, memory.orbit)
        return jnp.concatenate([outputs(found), self.stages.formation_law(memory.gain, deviation)])


def outputs(found: Telemetry) -> Array:
    """(16,) the first of `OUTPUTS`, after navigation."""
    truth, servicer, relative = found.truth, found.flight.orbit.servicer, found.flight.orbit.relative
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    rho, rho_dot = closed_loop.relative_state(truth)
    return jnp.concatenate(
        [
            rho,
            rho_dot,
            apply(R_HN, relative.r_TS_N + truth.r_ST_N),
            apply(R_HN, relative.v_TS_N + truth.v_ST_N),
            apply(R_HN, servicer.r_SN_N - (truth.r_TN_N + truth.r_ST_N)),
            truth.delta_v[None],
        ]
    )


class Compiled:
    """A loop compiled: the nominal run of one burn period, its derivatives on all devices, and a decision."""

    def __init__(self, loop: Loop, state: State, tumble: Tumble, samples: int) -> None:
        begin = time.perf_counter()
        self.loop = loop
        self.ticks = loop.scenario.formation_ticks
        count = jax.device_count()
        # The derivatives at different ticks do not depend on each other; the last share is filled up.
        self._rows = np.minimum(np.arange(-(-self.ticks // count) * count), self.ticks - 1)
        mesh = jax.make_mesh((count,), ("ticks",))
        spread = jax.sharding.PartitionSpec("ticks")
        derive = jax.shard_map(loop.derive, mesh=mesh, in_specs=(spread, spread), out_specs=spread, check_vma=False)
        self._placed = jax.sharding.NamedSharding(mesh, spread)
        seen = jnp.ones(self.ticks, dtype=bool)
        _, _, moments = jax.eval_shape(loop.fly, state, tumble, seen)
        part = jax.tree.map(
            lambda leaf: jax.ShapeDtypeStruct((len(self._rows), *leaf.shape[1:]), leaf.dtype, sharding=self._placed),
            (moments.state, moments.drawn),
        )
        lowered: list[Any] = [
            jax.jit(loop.fly).lower(state, tumble, seen),
            jax.jit(derive).lower(*part),
            jax.jit(loop.decide).lower(
                jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), moments.memory),
                state.tick,
                jnp.zeros((samples, 3)),
            ),
        ]
        with ThreadPoolExecutor(len(lowered)) as pool:
            self._fly, self._derive, self.decide = pool.map(lambda each: each.compile(), lowered)
        self.compile_s = time.perf_counter() - begin

    def period(self, state: State, tumble: Tumble, seen: np.ndarray) -> tuple[State, Tumble, Moment, np.ndarray]:
        """One burn period of the nominal run and its derivatives (ticks, size + 19, size + inputs)."""
        state, tumble, moments = self._fly(state, tumble, jnp.asarray(seen))
        own = jax.tree.map(lambda leaf: np.asarray(leaf)[self._rows], (moments.state, moments.drawn))
        derivatives = self._derive(*jax.device_put(own, self._placed))
        return state, tumble, moments, np.asarray(derivatives)[: self.ticks]
