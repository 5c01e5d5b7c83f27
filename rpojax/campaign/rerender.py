"""What the camera of a run saw: the pictures of a scenario whose camera is rendered, taken again after the run.

A history says of every tick where camera and target were and which part of the frame was looked at, in single
precision, and the noise of a picture follows from seed, run number and tick. So a picture is the one that the detector
got but for rounding: a code value may differ by one here and there.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from rpojax.campaign import run_and_resume, single_run
from rpojax.core.pytree import replace
from rpojax.dispersions import designs
from rpojax.dispersions.designs import RunRange
from rpojax.errors import ResultError, RpojaxError
from rpojax.physics.plant import Truth
from rpojax.scenario import scenario_file
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import camera_models, closed_loop, noise

History = Mapping[str, np.ndarray]

_POSE_CHANNELS = ("r_TN_N", "r_ST_N", "q_TN", "q_BN")
_REQUIRED_CHANNELS = (*_POSE_CHANNELS, "window_px")


def rendered_scenario(configuration: Mapping[str, Any]) -> ScenarioFile:
    """Scenario of a campaign's `info`, if pictures of its runs can be taken again.

    Raises:
        RpojaxError: its camera takes no pictures, or the trained files are not those of the campaign.
    """
    model = configuration["scenario"]["camera"]["model"]
    if model != "rendered":
        raise RpojaxError(f"camera.model: found {model!r}, which takes no pictures, expected 'rendered'")
    file = scenario_file.validate(configuration["scenario"])
    if scenario_file.digest(file) != configuration["scenario_hash"]:
        raise RpojaxError("imaging: found other trained files, expected those that the campaign was run with")
    return file


def replay_run(
    file: ScenarioFile,
    configuration: Mapping[str, Any],
    run_id: int,
    on_progress: run_and_resume.ProgressCallback | None = None,
) -> History:
    """Full history of a run that kept none, flown once more, alone.

    In a batch the last digits are others, and what hangs on a threshold may then go another way: the later in the run,
    the less is it bound to be the run of the campaign.

    Raises:
        RpojaxError: parts of the flight software were replaced.
    """
    if stages := configuration["stages"]:
        raise RpojaxError(f"run {run_id}: found replaced stages {sorted(stages)}, expected a run with a kept history")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        flown = run_and_resume.run_campaign(
            file,
            1,
            out,
            configuration["seed"],
            first_run=run_id,
            block_size=1,
            population=designs.recorded_run_range(configuration),
            on_progress=on_progress,
        )
        return flown.history(run_id)


def is_renderable(history: History, file: ScenarioFile) -> bool:
    """Whether a history has all that pictures need: some channels, and every tick."""
    time_s = history["time_s"]
    step_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0 / file.rates.camera_hz
    return "range_m" in history and set(_REQUIRED_CHANNELS) <= set(history) and step_s < 1.5 / file.rates.camera_hz


def valid_tick_count(history: History) -> int:
    """Number of ticks before a history ends or its run failed."""
    alive = np.isfinite(history["range_m"])
    return len(alive) if alive.all() else int(alive.argmin())


def render_images(
    file: ScenarioFile,
    seed: int,
    run_id: int,
    history: History,
    ticks: Sequence[int],
    population: RunRange | None = None,
) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Picture (p, p, 3), uint8 sRGB codes, and channels of each of some ticks of a run; one at a time is in memory.

    `population` are the runs of its campaign, by default this one.

    Raises:
        ResultError: the history does not say what its pictures showed.
    """
    if not is_renderable(history, file) and not (
        missing := [name for name in _REQUIRED_CHANNELS if name not in history]
    ):
        raise ResultError(f"run {run_id}: found a history without some ticks, expected one with all of them")
    if missing := [name for name in _REQUIRED_CHANNELS if name not in history]:
        raise ResultError(f"run {run_id}: found no channel {missing[0]!r}, expected the history of a rendered camera")
    static, chosen, state = single_run.initialise_run(file, seed, run_id, population)
    whole = len(history["time_s"])
    of_ticks = {name: values for name, values in history.items() if values.ndim and len(values) == whole}
    for tick in ticks:
        seen = {name: np.asarray(values[tick]) for name, values in of_ticks.items()}
        truth = replace(state.truth, **{name: np.asarray(seen[name], dtype=np.float64) for name in _POSE_CHANNELS})
        yield np.asarray(_render(static, chosen, truth, seen["window_px"], state.keys, np.int32(tick))), seen


@partial(jax.jit, static_argnums=0)
def _render(
    static: Scenario, chosen: Params, truth: Truth, window_px: Float[Array, "3"], keys: Array, tick: Array
) -> UInt8[Array, "p p 3"]:
    sky = closed_loop.sky_at(static, tick.astype(jnp.float64) * static.tick_s)
    view = camera_models.recorded_window(static, chosen, window_px)
    picture = camera_models.render_picture(static, chosen, view, truth, sky, noise.camera_key(keys, tick), tick)
    return jnp.round(255.0 * picture).astype(jnp.uint8)
