"""What the nominal runs of a linear covariance have in common: the loop about its mean, compiled, and its sources."""

import jax
import jax.numpy as jnp

from rpojax.analysis.linear_covariance import (
    describing_function,
    dispersion_linearisation,
    initial_conditions,
    target_outline_ensemble,
    tick_noise_vector,
)
from rpojax.analysis.linear_covariance.deviation_vector import make_layout
from rpojax.analysis.linear_covariance.linearised_loop import CompiledLoop, LinearisedLoop
from rpojax.core.pytree import replace
from rpojax.dispersions import dispersed_values
from rpojax.flight.computer import Stages
from rpojax.scenario import params, scenario_file
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop

_SAMPLES_POWER = 10
"""Two to this power is the number of points of a describing function."""
_SPAN = 10
"""Shares of the sources are looked at once in so many ticks, or less."""


class AnalysisSetup:
    """What the nominal runs have in common."""

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        self.file = file
        found = dispersion_linearisation.linearise_dispersions(file)
        self.left_out = found.left_out
        static = scenario_file.static_settings(file)
        base = params.build_params(file.model_dump(), static.width_px, static.height_px)
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = dispersed_values.apply_to_params(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = closed_loop.run_key(0, 0)
        state = jax.eval_shape(lambda: closed_loop.init(static, centre, key))
        self.loop = LinearisedLoop(static, centre, make_layout(state, centre, found.constant_paths()), stages)
        self.initial_conditions = initial_conditions.initial_conditions(static, centre, self.loop.layout, key, found)
        self.ensemble = target_outline_ensemble.initial_ensemble(file, base, members)
        self.normal_points = describing_function.normal_points(3, _SAMPLES_POWER)
        self.compiled = CompiledLoop(
            self.loop, self.initial_conditions[0].state, self.ensemble, len(self.normal_points)
        )
        self.sources = tick_noise_vector.source_names(self.initial_conditions[0].columns)
        self.source_index = {name: number for number, name in enumerate(self.sources)}
        self.noise_sources = [*self.loop.noise_vector.slices, tick_noise_vector.BURN, tick_noise_vector.DECISION]
        self.noise_sigma = self.loop.noise_vector.sigma(self.edge_noise_px)
        self.span_ticks = max(span for span in range(1, _SPAN + 1) if static.formation_ticks % span == 0)
