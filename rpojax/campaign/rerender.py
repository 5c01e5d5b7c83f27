"""Re-rendering of the camera images of a run from its history, for scenarios with a rendered camera.

A history holds, for every tick and in single precision, the poses of camera and target and the window of the frame. The
image noise follows from seed, run number and tick. So an image is that which the detector got, except for rounding: an
sRGB code may differ by one.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from rpojax.campaign import single_run
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import ResultError, RpojaxError
from rpojax.flight.guidance.lens_choice import LensInUse
from rpojax.physics.plant_state import Truth
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import camera_models, noise
from rpojax.simulation.state import elapsed_time

History = Mapping[str, np.ndarray]
"""Channel -> (ticks, ...)."""

_POSE_CHANNELS = ("r_TN_N", "r_ST_N", "q_TN", "q_BN")
_REQUIRED_CHANNELS = (*_POSE_CHANNELS, "window_px")


def rendered_scenario(scenario: Mapping[str, Any], scenario_hash: str) -> ScenarioFile:
    """Scenario of a campaign whose images can be re-rendered, from those entries of its `campaign.json`.

    Raises:
        RpojaxError: its camera renders no images, or the trained files are not those of the campaign.
    """
    model = scenario["camera"]["model"]
    if model != "rendered":
        raise RpojaxError(f"camera.model: found {model!r}, which takes no pictures, expected 'rendered'")
    file = scenario_loader.validate(dict(scenario))
    if scenario_digest(file) != scenario_hash:
        raise RpojaxError("imaging: found other trained files, expected those that the campaign was run with")
    return file


def is_renderable(history: History, file: ScenarioFile) -> bool:
    """Whether a history has the channels that images need, at every tick."""
    time_s = history["time_s"]
    step_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0 / file.rates.camera_hz
    return "range_m" in history and set(_REQUIRED_CHANNELS) <= set(history) and step_s < 1.5 / file.rates.camera_hz


def valid_tick_count(history: History) -> int:
    """Number of ticks before a history, of one servicer or of a team, ends or its run failed."""
    valid = np.all(np.isfinite(history["range_m"]).reshape(len(history["time_s"]), -1), axis=1, keepdims=True)[:, 0]
    return len(valid) if valid.all() else int(valid.argmin())


def render_images(
    file: ScenarioFile,
    seed: int,
    run_id: int,
    history: History,
    ticks: Sequence[int],
    run_range: RunRange | None = None,
    servicer: int | None = None,
) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Images of some ticks of a run, one after the other: (p, p, 3) uint8 sRGB codes, and the channels of the tick.

    Args:
        file: the scenario
        seed: master seed
        run_id: number of the run
        history: of the run, or of one servicer of a team
        ticks: to render
        run_range: that of the campaign's design, by default this run alone
        servicer: number of the servicer of a team, None for one alone

    Raises:
        ResultError: the history lacks channels or ticks.
    """
    if missing := [name for name in _REQUIRED_CHANNELS if name not in history]:
        raise ResultError(f"run {run_id}: found no channel {missing[0]!r}, expected the history of a rendered camera")
    if not is_renderable(history, file):
        raise ResultError(f"run {run_id}: found a history without some ticks, expected one with all of them")
    scenario, params, state = single_run.initialise_run(file, seed, run_id, run_range, servicer)
    samples = len(history["time_s"])
    time_series = {name: values for name, values in history.items() if values.ndim and len(values) == samples}
    for tick in ticks:
        channels = {name: np.asarray(values[tick]) for name, values in time_series.items()}
        pose = {name: np.asarray(channels[name], dtype=np.float64) for name in _POSE_CHANNELS}
        truth = replace(state.truth, **pose)
        is_wide = jnp.asarray(channels.get("wide_lens", False))
        lens = LensInUse(is_wide=is_wide, was_wide=is_wide)
        image = _render(scenario, params.seen_through(lens), truth, channels["window_px"], state.keys, np.int32(tick))
        yield np.asarray(image), channels


@partial(jax.jit, static_argnums=0)
def _render(
    scenario: Scenario, params: Params, truth: Truth, window_px: Float[Array, "3"], keys: Array, tick: Array
) -> UInt8[Array, "p p 3"]:
    sky = sun_and_moon_at(params.epoch, elapsed_time(scenario, truth, tick))
    window = camera_models.recorded_window(scenario, params, window_px)
    key = noise.camera_key(keys, tick)
    image = camera_models.render_picture(scenario, params, window, truth, sky, key, tick)
    return jnp.round(255.0 * image).astype(jnp.uint8)
