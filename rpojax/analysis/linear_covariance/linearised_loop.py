"""The closed loop along its nominal run, and its derivative at every tick, compiled once for one burn period."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.linear_covariance import target_outline_ensemble, tick_noise_vector
from rpojax.analysis.linear_covariance.deviation_vector import DeviationLayout
from rpojax.analysis.linear_covariance.target_outline_ensemble import RelativeBox, TargetEnsemble
from rpojax.analysis.linear_covariance.tick_noise_vector import TickNoiseVector
from rpojax.batching import vmap_last_axis
from rpojax.core.frames import apply, hill_frame
from rpojax.core.pytree import pytree
from rpojax.core.pytree import replace as put_in
from rpojax.flight import computer
from rpojax.flight.computer import FlightMemory, Stages
from rpojax.flight.guidance import burn_planning, target_pointing
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import closed_loop, telemetry
from rpojax.simulation.closed_loop import State, Telemetry
from rpojax.simulation.noise import TickNoise

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
class LinearisationPoint:
    """The nominal run at the beginning of a tick.

    Attributes:
        state: before the tick
        drawn: random numbers of the tick
        framing: of the mean outline about the nominal one
        edges: (members, 4) deviations of the targets' outlines [px]
        outputs: (19,) as `OUTPUTS`
        sigma_H: (3,) of the relative position as the filter sees it, in H [m]
        seen: () bool, the filter used a box
        quiet: () bool, the camera is on the target and no slew under way
        memory: flight software's memory with which a burn would be decided
    """

    state: State
    noise: TickNoise
    relative_box: RelativeBox
    edge_deviations: Array
    outputs: Array
    sigma_H: Array
    box_used: Array
    on_target: Array
    memory: FlightMemory


@dataclass(frozen=True)
class LinearisedLoop:
    """A scenario's loop about the mean of its dispersions; box edges are in pixels, not in sigmas.

    Attributes:
        scenario: static settings
        params: mean numbers, the camera's edge noise one pixel
        layout: the vector of deviations
        stages: of the flight software
    """

    scenario: Scenario
    params: Params
    layout: DeviationLayout
    stages: Stages

    @property
    def noise_vector(self) -> TickNoiseVector:
        """The random numbers of a tick as a vector."""
        return TickNoiseVector(self.scenario.substeps)

    def _own(self, params: Params, state: State) -> Array:
        return target_outline_ensemble.target_outline(self.scenario, params, state.truth.q_TN, state.truth)

    def simulate_nominal(
        self, state: State, tumble: TargetEnsemble, seen: Array
    ) -> tuple[State, TargetEnsemble, LinearisationPoint]:
        """The nominal run over as many ticks as `seen` (ticks,) has flags, which allow a box each."""

        def one(
            carry: tuple[State, TargetEnsemble], seen: Array
        ) -> tuple[tuple[State, TargetEnsemble], LinearisationPoint]:
            state, tumble = carry
            shown = target_outline_ensemble.ensemble_outlines(self.scenario, self.params, tumble, state.truth)
            own = self._own(self.params, state)
            drawn = tick_noise_vector.zero_noise(self.scenario.substeps, shown.mean - own, seen)
            after, found = closed_loop.tick(self.stages, self.scenario, self.params, state, drawn)
            sigma_H = telemetry.compute_channels(self.scenario, self.params, found)["relative_sigma_H"]
            moment = LinearisationPoint(
                state=state,
                noise=drawn,
                relative_box=target_outline_ensemble.relative_box(own, shown.mean),
                edge_deviations=shown.deviations,
                outputs=self._outputs(self.params, found),
                sigma_H=sigma_H,
                box_used=found.innovation.accepted,
                on_target=found.mode == Mode.LOOK,
                # Guidance goes on after the decision; what it remembered before counts.
                memory=put_in(found.flight, pointing=state.flight.pointing),
            )
            turned = target_outline_ensemble.propagate_ensemble(self.scenario, self.params, tumble, state.truth.r_TN_N)
            return (after, turned), moment

        (state, tumble), moments = jax.lax.scan(one, (state, tumble), seen)
        return state, tumble, moments

    def step(self, state: State, drawn: TickNoise, framing: RelativeBox) -> Callable[[Array], Array]:
        """The tick as a function of one vector: (size + inputs,) deviating numbers to (size + 19,) next ones, outputs.

        Numbers that do not deviate are those of `state`; inputs are added to `drawn`.
        """
        size = self.layout.size

        def step(both: Array) -> Array:
            moved, params = self.layout.unpack(both[:size], state, self.params)
            own = self._own(params, moved)
            # The mean outline grows and moves as the nominal one does, not by as many pixels.
            shift = target_outline_ensemble.apply_relative_box(own, framing) - own
            noise = self.noise_vector.unpack(both[size:], put_in(drawn, box=jnp.concatenate([shift, drawn.camera[4:]])))
            after, found = closed_loop.tick(self.stages, self.scenario, params, moved, noise)
            return jnp.concatenate([self.layout.pack(after, params), self._outputs(params, found)])

        return step

    def jacobians(self, states: State, drawn: TickNoise, framings: RelativeBox) -> Array:
        """Derivatives (ticks, size + 19, size + inputs) of `step` at each tick."""

        def one(moment: tuple[State, TickNoise, RelativeBox]) -> Array:
            step, point = self.step(*moment), self.nominal_vector(moment[0])

            def along(direction: Array) -> Array:
                return jax.jvp(step, (point,), (direction,))[1]

            return vmap_last_axis.vmap(along, in_axes=-1, out_axes=-1)(jnp.eye(point.size))

        return jax.lax.map(one, (states, drawn, framings))

    def nominal_vector(self, state: State) -> Array:
        """The vector (size + inputs,) at which a tick is the nominal one."""
        return jnp.concatenate([self.layout.pack(state, self.params), jnp.zeros(self.noise_vector.size)])

    def burns_for_commands(self, memory: FlightMemory, tick: Array, laws: Array) -> tuple[Array, Array]:
        """Burns (samples, 3) [m/s] in N that flight software makes of outputs (samples, 3) of its control law.

        Also from when to when (samples, 2) [s] it then looks away.
        """
        time = tick.astype(jnp.float64) * self.scenario.tick_s
        sky = closed_loop.sky_at(self.scenario, time)
        sight = target_pointing.point_at_target(self.params.flight.vehicle, memory.orbit, sky.sun_N)

        def one(law: Array) -> tuple[Array, Array]:
            stages = replace(self.stages, formation_law=lambda gain, deviation: law)
            plan = computer.plan_burn(stages, self.params.flight, memory, sight, time).plan
            turn = plan.ignition - plan.turn_start
            return plan.delta_v_N, jnp.stack([plan.turn_start, plan.cutoff + turn])

        return jax.vmap(one)(laws)

    def _outputs(self, params: Params, found: Telemetry) -> Array:
        memory = found.flight
        deviation, _ = burn_planning.deviation_at_burn(params.flight.formation, memory.station_keeping, memory.orbit)
        return jnp.concatenate([navigation_outputs(found), self.stages.formation_law(memory.gain, deviation)])


def navigation_outputs(found: Telemetry) -> Array:
    """(16,) the first of `OUTPUTS`, after navigation."""
    truth, servicer, relative = found.truth, found.flight.orbit.servicer, found.flight.orbit.relative
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    rho, rho_dot = closed_loop.true_relative_state(truth)
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


class CompiledLoop:
    """A loop compiled: the nominal run of one burn period, its derivatives on all devices, and a decision."""

    def __init__(self, loop: LinearisedLoop, state: State, tumble: TargetEnsemble, samples: int) -> None:
        begin = time.perf_counter()
        self.loop = loop
        self.ticks = loop.scenario.formation_ticks
        count = jax.device_count()
        self._batch = _BATCH * count
        mesh = jax.make_mesh((count,), ("ticks",))
        spread = jax.sharding.PartitionSpec("ticks")
        derive = jax.shard_map(
            loop.jacobians, mesh=mesh, in_specs=(spread, spread, spread), out_specs=spread, check_vma=False
        )
        self._placed = jax.sharding.NamedSharding(mesh, spread)
        seen = jnp.ones(self.ticks, dtype=bool)
        _, _, moments = jax.eval_shape(loop.simulate_nominal, state, tumble, seen)
        part = jax.tree.map(
            lambda leaf: jax.ShapeDtypeStruct((self._batch, *leaf.shape[1:]), leaf.dtype, sharding=self._placed),
            (moments.state, moments.drawn, moments.framing),
        )
        lowered: list[Any] = [
            jax.jit(loop.simulate_nominal).lower(state, tumble, seen),
            jax.jit(derive).lower(*part),
            jax.jit(loop.burns_for_commands).lower(
                jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), moments.memory),
                state.tick,
                jnp.zeros((samples, 3)),
            ),
        ]
        with ThreadPoolExecutor(len(lowered)) as pool:
            self._fly, self._derive, self.burns_for_commands = pool.map(lambda each: each.compile(), lowered)
        self.compile_s = time.perf_counter() - begin

    def simulate_period(
        self, state: State, tumble: TargetEnsemble, seen: np.ndarray
    ) -> tuple[State, TargetEnsemble, LinearisationPoint]:
        """One burn period of the nominal run."""
        return self._fly(state, tumble, jnp.asarray(seen))

    def jacobians(self, moments: LinearisationPoint, ticks: np.ndarray) -> np.ndarray:
        """Derivatives (ticks, size + 19, size + inputs) at some ticks of a period."""
        leaves = jax.tree.map(np.asarray, (moments.state, moments.noise, moments.relative_box))
        parts = []
        for first in range(0, len(ticks), self._batch):
            # The last batch is filled up with the last tick.
            rows = ticks[np.minimum(first + np.arange(self._batch), len(ticks) - 1)]
            own = jax.tree.map(lambda leaf, rows=rows: leaf[rows], leaves)
            parts.append(self._derive(*jax.device_put(own, self._placed)))
        return np.concatenate([np.asarray(part) for part in parts])[: len(ticks)]


_BATCH = 10
"""Ticks whose derivatives a device works out at once."""
