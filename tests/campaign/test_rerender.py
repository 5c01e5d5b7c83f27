"""Pictures taken again after a run are those that the detector got."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign

from rpojax.campaign import rerender, single_run
from rpojax.campaign.history_replay import replay_history
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.flight.computer import Stages
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import camera_models, noise
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.simulation.step_stages import sun_and_moon_at

TICKS = 6
SEED, RUN = 5, 3
FRAME = ("camera.width_px=320", "camera.height_px=240", "camera.field_of_view_deg=40.0")
"""Larger than the detector's square, so that the window is a part of the frame and moves with the target."""


@dataclass(frozen=True)
class Flown:
    """A few ticks of a run, and the pictures that its loop made.

    Attributes:
        file: scenario
        history: channels, time first
        pictures: (ticks, p, p, 3) sRGB codes in 0..1
    """

    file: ScenarioFile
    history: dict[str, np.ndarray]
    pictures: np.ndarray


@pytest.fixture(scope="session")
def flown() -> Flown:
    file = scenario_loader.load("inspection", ("camera.model=rendered", f"duration_s={TICKS}", *FRAME))
    static, chosen, start = single_run.initialise_run(file, SEED, RUN)

    def tick(state: State, _: None) -> tuple[State, Any]:
        after, seen = step(static, chosen, state, Stages())
        view = camera_models.detector_window(static, chosen, state.flight)
        sky = sun_and_moon_at(static, state.tick.astype(jnp.float64) * static.tick_s)
        key = noise.camera_key(state.keys, state.tick)
        picture = camera_models.render_picture(static, chosen, view, state.truth, sky, key, state.tick)
        return after, (compute_channels(static, chosen, seen), picture)

    _, (channels, pictures) = jax.jit(lambda state: jax.lax.scan(tick, state, None, length=TICKS))(start)
    history = {"time_s": np.arange(TICKS) * static.tick_s, **jax.tree.map(np.asarray, channels)}
    return Flown(file, history, np.asarray(pictures))


@pytest.fixture
def folder(flown: Flown, tmp_path: Path) -> Campaign:
    """A campaign folder that holds that run's history, and nothing else."""
    made = empty_campaign(tmp_path / "runs", flown.file, SEED, 4, 0, 1, [RUN])
    made.write_history(RUN, flown.history)
    return made


def test_pictures_taken_again_are_those_of_the_loop(flown: Flown) -> None:
    shots = list(rerender.render_images(flown.file, SEED, RUN, flown.history, range(TICKS)))
    found = np.stack([picture for picture, _ in shots]).astype(float)
    made = 255.0 * flown.pictures
    assert made.std() > 1.0
    # Half a code for rounding, and the noise of the pose in single precision where a picture is steep.
    assert np.quantile(np.abs(found - made), 0.999) < 0.6
    assert np.abs(found - made).max() < 3.0
    # Without the noise, or at another tick, they would not be.
    assert np.abs(found[1:] - made[:-1]).max() > 10.0


def test_every_picture_comes_with_the_channels_of_its_tick(flown: Flown) -> None:
    ((picture, seen),) = rerender.render_images(flown.file, SEED, RUN, flown.history, [4])
    assert (picture.dtype, picture.shape) == (np.uint8, flown.pictures.shape[1:])
    assert seen["time_s"] == 4.0
    np.testing.assert_array_equal(seen["box_px"], flown.history["box_px"][4])
    assert set(seen) == set(flown.history)


def test_the_window_lies_in_the_frame(flown: Flown) -> None:
    left, top, side = flown.history["window_px"].T
    assert (left >= 0.0).all()
    assert (top >= 0.0).all()
    assert (side >= flown.pictures.shape[1]).all()
    assert (side <= 320.0).all()


def test_the_score_is_a_share(flown: Flown) -> None:
    score = flown.history["box_score"]
    assert ((score > 0.0) & (score < 1.0)).all()


def test_a_history_without_poses_is_refused_by_the_name_of_what_it_lacks(flown: Flown) -> None:
    poor = {name: values for name, values in flown.history.items() if name != "q_TN"}
    with pytest.raises(ResultError, match=r"run 3: found no channel 'q_TN'"):
        next(rerender.render_images(flown.file, SEED, RUN, poor, [0]))


def test_a_run_ends_where_it_failed() -> None:
    assert rerender.valid_tick_count({"range_m": np.array([3.0, 2.0, np.nan, np.nan])}) == 2
    assert rerender.valid_tick_count({"range_m": np.array([3.0, 2.0])}) == 2


def test_the_scenario_of_a_campaign_is_that_of_its_pictures(folder: Campaign, flown: Flown) -> None:
    assert rerender.rendered_scenario(folder.info) == flown.file


@pytest.mark.parametrize("model", ["geometric", "statistical"])
def test_a_camera_without_pictures_is_refused(model: str) -> None:
    with pytest.raises(RpojaxError, match=f"camera.model: found '{model}', which takes no pictures"):
        rerender.rendered_scenario({"scenario": {"camera": {"model": model}}})


def test_other_trained_files_than_the_campaigns_are_refused(folder: Campaign) -> None:
    with pytest.raises(RpojaxError, match="imaging: found other trained files"):
        rerender.rendered_scenario(folder.info | {"scenario_hash": "0" * 64})


def test_a_run_with_replaced_stages_cannot_be_flown_again(folder: Campaign, flown: Flown) -> None:
    stages = {"update_orbit": {"function": "mine", "source_sha256": None}}
    with pytest.raises(RpojaxError, match=r"run 1: found replaced stages \['update_orbit'\]"):
        replay_history(flown.file, folder.info | {"stages": stages}, 1)


@pytest.mark.slow
def test_a_run_without_a_history_is_flown_again_with_its_own_numbers(folder: Campaign, flown: Flown) -> None:
    again = replay_history(flown.file, folder.info, RUN)
    np.testing.assert_allclose(again["rho_H"], flown.history["rho_H"], rtol=1e-4)
    np.testing.assert_allclose(again["box_score"], flown.history["box_score"], atol=0.01)


@pytest.fixture
def film(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., tuple[int, str]]]:
    """The verb in this process: exit status, and what it said on stdout or, refused, on stderr."""
    from rpojax.cli import main

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["film", *map(str, words)])
        said = capsys.readouterr()
        return status, said.err if status else said.out

    yield run


def test_the_verb_writes_a_sheet_and_a_film(folder: Campaign, film: Callable[..., Any], tmp_path: Path) -> None:
    import cv2

    sheet, movie = tmp_path / "new" / "seen.png", tmp_path / "seen.mp4"
    assert film(folder.directory, "--run-id", RUN, "--out", sheet) == (0, f"{sheet}\n")
    assert film(folder.directory, "--every", 2, "--out", movie) == (0, f"{movie}\n")
    assert cv2.imread(str(sheet)).shape[1] > 4 * 384
    capture = cv2.VideoCapture(str(movie))
    count = 0
    while capture.read()[0]:
        count += 1
    assert count == TICKS / 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "runs", "seen.mp4"]


def test_the_verb_does_not_overwrite(folder: Campaign, film: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "mine.png").write_text("mine")
    assert film(folder.directory, "--out", tmp_path / "mine.png") == (
        2,
        f"rpojax: error: {tmp_path / 'mine.png'}: exists already; --force replaces it\n",
    )
    assert (tmp_path / "mine.png").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "seen.gif"], "seen.gif: found suffix '.gif', expected .png or .mp4"),
        (["--out", "s.mp4", "--every", "0"], "--every: found 0, expected at least 1"),
        (["--out", "s.mp4", "--run-id", "4"], "--run-id: found 4, expected a run of this campaign, 0 to 3"),
    ],
)
def test_the_verb_refuses_in_one_line(folder: Campaign, film: Callable[..., Any], words: list[str], said: str) -> None:
    assert film(folder.directory, *words) == (2, f"rpojax: error: {said}\n")


def test_a_campaign_without_pictures_is_refused_in_one_line(
    inspection_file: ScenarioFile, film: Callable[..., Any], tmp_path: Path
) -> None:
    made = empty_campaign(tmp_path / "runs", inspection_file, SEED, 4, 0, 1, [])
    status, said = film(made.directory, "--out", tmp_path / "seen.mp4")
    assert (status, said.count("\n")) == (2, 1)
    assert "camera.model: found 'geometric', which takes no pictures, expected 'rendered'" in said


def test_a_place_that_cannot_be_written_to_is_named(folder: Campaign, film: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name in ("seen.mp4", "seen.png"):
        status, said = film(folder.directory, "--out", tmp_path / "file" / name)
        assert status == 2
        assert f"rpojax: error: {tmp_path / 'file' / name}: found " in said
