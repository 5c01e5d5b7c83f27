"""What the nominal runs of a linear covariance have in common: the loop about its mean, compiled, and its sources."""

import jax
import jax.numpy as jnp

from rpojax.analysis import describing_function, linear_inputs, linear_sources, linear_start, outlines
from rpojax.analysis.linear_loop import Compiled, Loop
from rpojax.analysis.linear_state import layout
from rpojax.campaign import dispersions
from rpojax.core.pytree import replace
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, params, scenario
from rpojax.simulation.schema import ScenarioFile

_SAMPLES_POWER = 10
"""Two to this power is the number of points of a describing function."""
_SPAN = 10
"""Shares of the sources are looked at once in so many ticks, or less."""


class Setup:
    """What the nominal runs have in common."""

    def __init__(self, file: ScenarioFile, members: int, stages: Stages) -> None:
        self.file = file
        found = linear_sources.disperse(file)
        self.left_out = found.left_out
        static = scenario.static(file)
        base = params.build(file.model_dump(), static.width_px, static.height_px)
        self.edge_noise_px = float(base.camera.edge_noise)
        centre = dispersions.apply(base, {key: jnp.asarray(value) for key, value in found.mean.items()})
        centre = replace(centre, camera=replace(centre.camera, edge_noise=jnp.ones((), dtype=jnp.float64)))
        key = closed_loop.run_key(0, 0)
        state = jax.eval_shape(lambda: closed_loop.init(static, centre, key))
        self.loop = Loop(static, centre, layout(state, centre, found.constants()), stages)
        self.starts = linear_start.starts(static, centre, self.loop.layout, key, found)
        self.tumble = outlines.start(file, base, members)
        self.points = describing_function.normal_points(3, _SAMPLES_POWER)
        self.compiled = Compiled(self.loop, self.starts[0].state, self.tumble, len(self.points))
        self.sources = linear_inputs.names(self.starts[0].columns)
        self.number = {name: number for number, name in enumerate(self.sources)}
        self.noises = [*self.loop.inputs.parts, linear_inputs.BURN, linear_inputs.DECISION]
        self.sigma = self.loop.inputs.sigma(self.edge_noise_px)
        self.span = max(span for span in range(1, _SPAN + 1) if static.formation_ticks % span == 0)
