"""Common part of the nominal runs of a linear covariance: the compiled loop, its layout and the error sources."""

import jax
import jax.numpy as jnp

from rpojax.analysis.linear_covariance import burn_decision
from rpojax.analysis.linear_covariance.linearisation import (
    deviation_vector,
    dispersion_linearisation,
    target_outline_ensemble,
)
from rpojax.analysis.linear_covariance.linearisation.compiled_loop import CompiledLoop
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import make_layout
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import LinearisedLoop
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.flight.stages import Stages
from rpojax.scenario import params
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.measurement_delays import delay_settings
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key

_LOG2_POINTS = 10
"""Binary logarithm of the number of points of the describing function."""
_MAX_SPAN_TICKS = 10
"""Most ticks between two evaluations of the variance shares."""


class AnalysisSetup:
    """Common part of the nominal runs.

    Attributes:
        file: the scenario
        left_out: names of dispersions whose effect is left out
        edge_noise_px: of the box [px]
        loop: about the mean of the dispersions
        initial_conditions: of the nominal runs
        ensemble: of targets
        normal_points: (samples, 3) of the describing function
        compiled: the loop, compiled
        sources: names of all error sources
        source_index: of each name
        noise_sources: names of the sources of white noise
        noise_sigma: (inputs,) standard deviations of a tick's random numbers
        span_ticks: ticks between two evaluations of the variance shares
    """

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        refuse_team(file, "a linear covariance analysis")
        if file.phases:
            expected = "a scenario without phases for a linear covariance analysis"
            raise ScenarioError("phases", len(file.phases), expected)
        if file.wide_lens is not None:
            raise ScenarioError("wide_lens", "a second lens", "one lens for a linear covariance analysis")
        if (late := delay_settings(file)) is not None:
            expected = "no late measurements for a linear covariance analysis"
            raise ScenarioError(f"{late.sensors[0]}.delay_s", "late measurements", expected)
        self.file = file
        found = dispersion_linearisation.linearise_dispersions(file)
        self.left_out = found.left_out
        static = static_settings(file)
        base = params.build_params(file.model_dump(), static.width_px, static.height_px)
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = dispersed_values.apply_to_params(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = run_key(0, 0)
        state = jax.eval_shape(lambda: initial_state.init(static, centre, key))
        self.loop = LinearisedLoop(static, centre, make_layout(state, centre, found.constant_paths()), stages)
        self.initial_conditions = dispersion_linearisation.initial_conditions(
            static, centre, self.loop.layout, key, found
        )
        self.ensemble = target_outline_ensemble.initial_ensemble(file, base, members)
        self.normal_points = burn_decision.normal_points(3, _LOG2_POINTS)
        self.compiled = CompiledLoop(
            self.loop, self.initial_conditions[0].state, self.ensemble, len(self.normal_points)
        )
        self.sources = deviation_vector.source_names(self.initial_conditions[0].columns)
        self.source_index = {name: number for number, name in enumerate(self.sources)}
        self.noise_sources = [*self.loop.noise_vector.slices, deviation_vector.BURN, deviation_vector.DECISION]
        self.noise_sigma = self.loop.noise_vector.sigma(self.edge_noise_px)
        self.span_ticks = max(span for span in range(1, _MAX_SPAN_TICKS + 1) if static.formation_ticks % span == 0)
