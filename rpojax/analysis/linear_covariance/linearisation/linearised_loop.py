"""Linearisation of the closed loop: its nominal run, and the Jacobian of a tick along it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.analysis.linear_covariance.linearisation import deviation_vector, target_outline_ensemble
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import DeviationLayout, TickNoiseVector
from rpojax.analysis.linear_covariance.linearisation.target_outline_ensemble import RelativeBox, TargetEnsemble
from rpojax.batching import batching_mode
from rpojax.core.frames import hill_frame
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import pytree
from rpojax.core.pytree import replace as replace_leaves
from rpojax.core.vectors import apply
from rpojax.flight.decisions import burn_decision
from rpojax.flight.decisions.burn_decision import Decision
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory
from rpojax.flight.guidance import target_pointing
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.stages import Stages
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import State, elapsed_time, true_relative_state
from rpojax.simulation.step import step as simulate_tick
from rpojax.simulation.telemetry import Telemetry
from rpojax.simulation.tick import Loop

OUTPUTS = {
    "rho_H": slice(0, 3),
    "rho_dot_H": slice(3, 6),
    "relative_error_H": slice(6, 9),
    "relative_rate_error_H": slice(9, 12),
    "servicer_error_H": slice(12, 15),
    "delta_v_m_s": slice(15, 16),
    "command_H": slice(16, 19),
}
"""Outputs of every tick, and their slices in a vector (19,): [m], [m/s], in the true Hill frame of the run.

`command_H` is the output of the control law, before the conditions on a burn.
"""


@pytree
class LinearisationPoint:
    """The nominal run at the beginning of a tick.

    Attributes:
        state: before the tick
        noise: random numbers of the tick
        relative_box: of the ensemble's mean outline relative to the nominal one
        edge_deviations: (members, 4) deviations of the targets' outlines [px]
        outputs: (19,) as `OUTPUTS`
        sigma_H: (3,) of the relative position by the filter's covariance, in H [m]
        box_used: () bool, the filter used a box
        on_target: () bool, the camera is on the target and no slew under way
        memory: memory of the flight software that a burn decision starts from
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
    """Closed loop of a scenario about the mean of its dispersions; box edges are in pixels, not in sigmas.

    Attributes:
        scenario: static settings
        params: mean parameters, with an edge noise of one pixel
        layout: of the deviation vector
        stages: of the flight software
    """

    scenario: Scenario
    params: Params
    layout: DeviationLayout
    stages: Stages

    @property
    def noise_vector(self) -> TickNoiseVector:
        """Layout of the random numbers of a tick."""
        return TickNoiseVector(self.scenario.substeps)

    def _outline(self, params: Params, state: State) -> Array:
        return target_outline_ensemble.target_outline(self.scenario, params, state.truth.q_TN, state.truth)

    def simulate_nominal(
        self, state: State, ensemble: TargetEnsemble, box_allowed: Array
    ) -> tuple[State, TargetEnsemble, LinearisationPoint]:
        """The nominal run over a period; `box_allowed` (ticks,) flags frames that may have a box."""

        def tick(
            carry: tuple[State, TargetEnsemble], box_allowed: Array
        ) -> tuple[tuple[State, TargetEnsemble], LinearisationPoint]:
            state, ensemble = carry
            outlines = target_outline_ensemble.ensemble_outlines(self.scenario, self.params, ensemble, state.truth)
            nominal = self._outline(self.params, state)
            noise = deviation_vector.zero_noise(self.scenario.substeps, outlines.mean - nominal, box_allowed)
            after, telemetry = simulate_tick(self.scenario, self.params, state, self.stages, noise)
            box_used = telemetry.innovation.sensors["box"].accepted
            sigma_H = compute_channels(self.scenario, self.params, telemetry)["relative_sigma_H"]
            point = LinearisationPoint(
                state=state,
                noise=noise,
                relative_box=target_outline_ensemble.relative_box(nominal, outlines.mean),
                edge_deviations=outlines.deviations,
                outputs=self._outputs(self.params, telemetry),
                sigma_H=sigma_H,
                box_used=box_used,
                on_target=telemetry.mode == Mode.LOOK,
                # Guidance follows the decision, which therefore sees its memory from before.
                memory=replace_leaves(telemetry.flight, pointing=state.flight.pointing),
            )
            observed, outline = target_outline_ensemble.observe_ensemble(
                ensemble, outlines, box_used, self.scenario.tick_s
            )
            # The mean outline of all targets does not change as that of any one does.
            after = parameters.replace_leaf(after, ("flight", "orbit", "relative", "outline"), outline)
            turned = target_outline_ensemble.propagate_ensemble(
                self.scenario, self.params, observed, state.truth.r_TN_N
            )
            return (after, turned), point

        (state, ensemble), points = jax.lax.scan(tick, (state, ensemble), box_allowed)
        return state, ensemble, points

    def step(self, state: State, nominal: TickNoise, relative_box: RelativeBox) -> Callable[[Array], Array]:
        """A tick as a function of a vector: deviating state and inputs (size + inputs,) to next state and outputs
        (size + 19,).

        Numbers that do not deviate are those of `state`; inputs are added to the `nominal` noise.
        """
        size = self.layout.size

        def step(vector: Array) -> Array:
            deviated, params = self.layout.unpack(vector[:size], state, self.params)
            outline = self._outline(params, deviated)
            # The mean outline grows and moves in proportion to the nominal one, not by as many pixels.
            shift = target_outline_ensemble.apply_relative_box(outline, relative_box) - outline
            camera = jnp.concatenate([shift, nominal.camera[4:]])
            noise = self.noise_vector.unpack(vector[size:], replace_leaves(nominal, camera=camera))
            after, telemetry = simulate_tick(self.scenario, params, deviated, self.stages, noise)
            return jnp.concatenate([self.layout.pack(after, params), self._outputs(params, telemetry)])

        return step

    def jacobians(self, states: State, noises: TickNoise, relative_boxes: RelativeBox) -> Array:
        """Jacobians (ticks, size + 19, size + inputs) of `step` at each tick."""

        def jacobian(point: tuple[State, TickNoise, RelativeBox]) -> Array:
            step, vector = self.step(*point), self.nominal_vector(point[0])

            def along(direction: Array) -> Array:
                return jax.jvp(step, (vector,), (direction,))[1]

            return batching_mode.transform()(along, in_axes=-1, out_axes=-1)(jnp.eye(vector.size))

        return jax.lax.map(jacobian, (states, noises, relative_boxes))

    def nominal_vector(self, state: State) -> Array:
        """The vector (size + inputs,) at which a tick is the nominal one."""
        return jnp.concatenate([self.layout.pack(state, self.params), jnp.zeros(self.noise_vector.size)])

    def burns_for_commands(self, memory: FlightMemory, tick: Array, commands: Array) -> tuple[Array, Array]:
        """Burns (samples, 3) [m/s] in N that the flight software plans for commands (samples, 3) of its control law.

        Also begin and end (samples, 2) [s] of their look-aways.
        """
        time = tick.astype(jnp.float64) * self.scenario.tick_s
        sun_N = sun_and_moon_at(self.params.epoch, time).sun_N
        pointing = target_pointing.point_at_target(
            self.params.flight.vehicle, memory.orbit, memory.pointing.reference.q_EN, sun_N
        )
        predicted = predict_to_burn(self.params.flight, memory.orbit)
        decision = Decision(time=time, memory=memory, predicted=predicted, pointing=pointing)

        def burn(command: Array) -> tuple[Array, Array]:
            loop = Loop(self.scenario, self.params, replace(self.stages, formation_law=lambda: command))
            plan, _ = burn_decision.plan_burn(loop.software, decision)
            turn = plan.ignition - plan.turn_start
            return plan.delta_v_N, jnp.stack([plan.turn_start, plan.cutoff + turn])

        return jax.vmap(burn)(commands)

    def _outputs(self, params: Params, telemetry: Telemetry) -> Array:
        memory = telemetry.flight
        time = elapsed_time(self.scenario, telemetry.truth, telemetry.tick)
        software = Loop(self.scenario, params, self.stages).software
        command_H = burn_decision.formation_command(software, memory, time)
        return jnp.concatenate([navigation_outputs(telemetry), command_H])


def navigation_outputs(telemetry: Telemetry) -> Array:
    """The first 16 of `OUTPUTS`, after navigation."""
    truth, orbit = telemetry.truth, telemetry.flight.orbit
    servicer, relative = orbit.servicer, orbit.relative
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)
    rho, rho_dot = true_relative_state(truth)
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
