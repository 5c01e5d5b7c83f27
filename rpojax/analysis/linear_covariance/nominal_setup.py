"""What the nominal runs of a linear covariance have in common: the loop about its mean, compiled, and its sources."""

import jax
import jax.numpy as jnp

from rpojax.analysis.linear_covariance import (
    describing_function,
    dispersion_inputs,
    initial_deviation,
    noise_inputs,
    tumbling_target_outlines,
)
from rpojax.analysis.linear_covariance.deviation_vector import layout
from rpojax.analysis.linear_covariance.linearised_loop import Compiled, Loop
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


class Setup:
    """What the nominal runs have in common."""

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        self.file = file
        found = dispersion_inputs.disperse(file)
        self.left_out = found.left_out
        static = scenario_file.static(file)
        base = params.build(file.model_dump(), static.width_px, static.height_px)
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = dispersed_values.apply(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = closed_loop.run_key(0, 0)
        state = jax.eval_shape(lambda: closed_loop.init(static, centre, key))
        self.loop = Loop(static, centre, layout(state, centre, found.constants()), stages)
        self.starts = initial_deviation.starts(static, centre, self.loop.layout, key, found)
        self.tumble = tumbling_target_outlines.start(file, base, members)
        self.points = describing_function.normal_points(3, _SAMPLES_POWER)
        self.compiled = Compiled(self.loop, self.starts[0].state, self.tumble, len(self.points))
        self.sources = noise_inputs.names(self.starts[0].columns)
        self.number = {name: number for number, name in enumerate(self.sources)}
        self.noises = [*self.loop.inputs.parts, noise_inputs.BURN, noise_inputs.DECISION]
        self.sigma = self.loop.inputs.sigma(self.edge_noise_px)
        self.span = max(span for span in range(1, _SPAN + 1) if static.formation_ticks % span == 0)
