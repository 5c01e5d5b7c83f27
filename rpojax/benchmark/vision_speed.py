"""Speed of the rendered camera: images of the packaged target, and detections in them by the packaged detector."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.benchmark.timed_device_programs import MultiDeviceProgram, compile_for_devices
from rpojax.campaign import single_run
from rpojax.campaign.execution import batch_engine
from rpojax.core import random_streams
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.runtime.programs_per_device import choose_devices
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import rendered_camera
from rpojax.simulation import camera_models
from rpojax.simulation.state import State, elapsed_time
from rpojax.vision.detector import box_decoding, two_stage_detector

_RANGE_M = 30.0
"""Range at which the packaged mission keeps station."""


@dataclass(frozen=True)
class VisionSpeed:
    """Speed of rendering and detection for a batch of images as in a campaign.

    Attributes:
        batch: images at once, on all devices together
        devices: devices that share them
        side_px: width and height of an image
        range_m: of the target
        render_compile_s: tracing and compiling [s]
        detect_compile_s: the same of the detector [s]
        render_s: fastest pass of a batch [s]
        render_cpu_s: processor time of that pass [s]
        detect_s: fastest pass of the detector [s]
        detect_cpu_s: processor time of that pass [s]
        frames_per_s: images rendered per second
        detections_per_s: images searched by the detector per second
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
) -> tuple[MultiDeviceProgram, MultiDeviceProgram]:
    """Program that renders `size` images on each device, and one that detects boxes in them.

    By default they are as many as a block of a campaign has.
    """
    used = choose_devices(devices)
    place = f"[0.0, -{_RANGE_M}, 0.0]"
    file = scenario_loader.load("inspection", ["camera.model=rendered", f"initial.relative_position_m={place}"])
    size = size or batch_engine.default_block_size(file)
    scenario, params, state = single_run.initialise_run(file)
    params = jax.tree.map(np.asarray, params)  # numbers of the scenario are floats
    networks = params.networks
    assert networks is not None
    # One random attitude of the target per image, since the cost of an image depends on its content.
    attitudes = np.random.default_rng(0).standard_normal((len(used), size, 4))
    attitudes /= np.linalg.norm(attitudes, axis=2, keepdims=True)
    keys = jax.vmap(random_streams.fold_in, in_axes=(None, 0))(random_streams.master_key(0), jnp.arange(size))
    batched_render = jax.vmap(lambda *own: _render(scenario, *own), in_axes=(None, None, 0, 0))
    render = compile_for_devices(batched_render, [(params, state, q_TN, keys) for q_TN in attitudes], used)
    arguments = [(networks.detector, images) for images in render.run()]
    return render, compile_for_devices(jax.vmap(_detect, in_axes=(None, 0)), arguments, used)


def _render(scenario: Scenario, params: Params, state: State, q_TN: Array, key: Array) -> Array:
    truth = replace(state.truth, q_TN=q_TN)
    sky = sun_and_moon_at(params.epoch, elapsed_time(scenario, truth, state.tick))
    window = camera_models.commanded_window(scenario, params, state.flight.camera)
    return camera_models.render_picture(scenario, params, window, truth, sky, key, state.tick)


def _detect(weights: two_stage_detector.DetectorParams, image: Array) -> box_decoding.Detections:
    """Boxes in one image, with the settings of the closed loop."""
    return two_stage_detector.detect(weights, image[None], rendered_camera.REFINED_PROPOSALS)


def measure(size: int | None = None, devices: Sequence[Any] | None = None) -> VisionSpeed:
    """Images per second, `size` on each device, by default as many as a block of a campaign has."""
    render, detect = compile_camera_and_detector(size, devices)
    rendering, detection = render.fastest_pass(), detect.fastest_pass()
    images = detect.inputs[0][1]
    total = images.shape[0] * len(detect.inputs)
    return VisionSpeed(
        batch=total,
        devices=len(detect.inputs),
        side_px=images.shape[1],
        range_m=_RANGE_M,
        render_compile_s=render.compile_s,
        detect_compile_s=detect.compile_s,
        render_s=rendering.wall_s,
        render_cpu_s=rendering.cpu_s,
        detect_s=detection.wall_s,
        detect_cpu_s=detection.cpu_s,
        frames_per_s=total / rendering.wall_s,
        detections_per_s=total / detection.wall_s,
    )
