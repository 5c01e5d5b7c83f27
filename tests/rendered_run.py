"""A few ticks of a run with a rendered camera, with the images of its closed loop."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from named_loops import name_loop

from rpojax.campaign import single_run
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.flight.stages import Stages
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import camera_models, noise
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.state import State
from rpojax.simulation.step import step

TICKS = 8
SEED, RUN = 5, 3
FRAME = ("camera.width_px=320", "camera.height_px=240", "camera.field_of_view_deg=40.0")
"""Larger than the detector's square, so that the window is a part of the frame and moves with the target."""
NEAR = (
    "initial.relative_position_m=[0.0, -30.0, 0.0]",
    "navigation.initial_relative_position_sigma_m=0.2",
    "dispersions.initial.relative_position_m=none",
)
"""Where the detector finds it at once."""


@dataclass(frozen=True)
class RenderedRun:
    """A few ticks of a run, and the images of its closed loop.

    Attributes:
        file: scenario
        history: channels, time first
        images: (ticks, p, p, 3) sRGB codes in 0..1
    """

    file: ScenarioFile
    history: dict[str, np.ndarray]
    images: np.ndarray


def simulate_rendered_run() -> RenderedRun:
    """Simulates `TICKS` ticks of run `RUN` of `SEED`."""
    file = scenario_loader.load("inspection", ("camera.model=rendered", f"duration_s={TICKS}", *FRAME, *NEAR))
    name_loop("rendered", file)
    scenario, params, start = single_run.initialise_run(file, SEED, RUN)

    def tick(state: State, _: None) -> tuple[State, Any]:
        after, seen = step(scenario, params, state, Stages())
        window = camera_models.commanded_window(scenario, params, seen.flight.camera)
        sky = sun_and_moon_at(params.epoch, state.tick.astype(jnp.float64) * scenario.tick_s)
        key = noise.camera_key(state.keys, state.tick)
        image = camera_models.render_picture(scenario, params, window, state.truth, sky, key, state.tick)
        return after, (compute_channels(scenario, params, seen), image)

    _, (channels, images) = jax.jit(lambda state: jax.lax.scan(tick, state, None, length=TICKS))(start)
    history = {"time_s": np.arange(TICKS) * scenario.tick_s, **jax.tree.map(np.asarray, channels)}
    return RenderedRun(file, history, np.asarray(images))
