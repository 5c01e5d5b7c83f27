"""Speed of the rendered camera: pictures of the packaged target, and looks of the packaged detector at them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.benchmark import timing
from rpojax.benchmark.timing import DeviceProgram
from rpojax.campaign import single_run
from rpojax.campaign.execution import batch_engine
from rpojax.core import random_streams
from rpojax.core.pytree import replace
from rpojax.scenario import scenario_file
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import rendered_camera
from rpojax.simulation import camera_models, closed_loop
from rpojax.simulation.state import State
from rpojax.vision.detector import two_stage_detector

_RANGE_M = 30.0
"""Where the packaged mission keeps station."""


@dataclass(frozen=True)
class VisionSpeed:
    """Pictures as they are flown.

    Attributes:
        batch: pictures at once, on all devices together
        devices: devices that share them
        side_px: of a picture
        range_m: of the target
        render_compile_s: tracing and compiling [s]
        detect_compile_s: the same of the detector [s]
        render_s: fastest pass of a batch [s]
        render_cpu_s: what it took of the processor [s]
        detect_s: the same of the detector [s]
        detect_cpu_s: what it took of the processor [s]
        frames_per_s: pictures rendered per second
        detections_per_s: pictures looked at per second
    """

    batch: int
    devices: int
    side_px: int
    range_m: float
    render_compile_s: float
    detect_compile_s: float
    render_s: float
    render_cpu_s: float
    detect_s: float
    detect_cpu_s: float
    frames_per_s: float
    detections_per_s: float


def compile_camera_and_detector(
    size: int | None = None, devices: Sequence[Any] | None = None
) -> tuple[DeviceProgram, DeviceProgram]:
    """Program that takes `size` pictures on each device, and one that looks at them for boxes.

    By default they are as many as a campaign's block has.
    """
    used = list(jax.devices() if devices is None else devices)
    place = f"[0.0, -{_RANGE_M}, 0.0]"
    file = scenario_file.load("inspection", ["camera.model=rendered", f"initial.relative_position_m={place}"])
    size = size or batch_engine.default_block_size(file)
    static, params, state = single_run.initialise_run(file)
    networks = params.networks
    assert networks is not None
    # One turn of the target for each picture, for matter fills some views more than others.
    turns = np.random.default_rng(0).standard_normal((len(used), size, 4))
    turns /= np.linalg.norm(turns, axis=2, keepdims=True)
    keys = jax.vmap(random_streams.fold_in, in_axes=(None, 0))(random_streams.master_key(0), jnp.arange(size))
    take = jax.vmap(lambda *own: _render(static, *own), in_axes=(None, None, 0, 0))
    render = timing.compile_for_devices(take, [(params, state, share, keys) for share in turns], used)
    shown = [(networks.detector, pictures) for pictures in render.run()]
    return render, timing.compile_for_devices(jax.vmap(_detect, in_axes=(None, 0)), shown, used)


def _render(static: Scenario, params: Params, state: State, q_TN: Array, key: Array) -> Array:
    truth = replace(state.truth, q_TN=q_TN)
    sky = closed_loop.sky_at(static, state.tick.astype(jnp.float64) * static.tick_s)
    view = camera_models.detector_window(static, params, state.flight)
    return camera_models.render_picture(static, params, view, truth, sky, key, state.tick)


def _detect(weights: two_stage_detector.DetectorParams, picture: Array) -> two_stage_detector.Detections:
    """Boxes in one picture, as every run looks for them."""
    return two_stage_detector.detect(weights, picture[None], rendered_camera.REFINED_PROPOSALS)


def measure(size: int | None = None, devices: Sequence[Any] | None = None) -> VisionSpeed:
    """Pictures per second, `size` on each device, by default as many as a campaign's block has."""
    render, look = compile_camera_and_detector(size, devices)
    rendered, looked = render.fastest_pass(), look.fastest_pass()
    pictures = look.inputs[0][1]
    total = pictures.shape[0] * len(look.inputs)
    return VisionSpeed(
        batch=total,
        devices=len(look.inputs),
        side_px=pictures.shape[1],
        range_m=_RANGE_M,
        render_compile_s=render.compile_s,
        detect_compile_s=look.compile_s,
        render_s=rendered.wall_s,
        render_cpu_s=rendered.cpu_s,
        detect_s=looked.wall_s,
        detect_cpu_s=looked.cpu_s,
        frames_per_s=total / rendered.wall_s,
        detections_per_s=total / looked.wall_s,
    )
