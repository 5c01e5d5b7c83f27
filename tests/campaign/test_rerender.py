"""Re-rendered images equal those that the detector got in the closed loop."""

import numpy as np
import pytest
from rendered_run import RUN, SEED, TICKS, RenderedRun

from rpojax.campaign import rerender
from rpojax.campaign.storage.campaign_folder import Campaign, of_servicer
from rpojax.errors import ResultError, RpojaxError, ScenarioError


def test_rerendered_images_are_those_of_the_loop(rendered_run: RenderedRun) -> None:
    images = rerender.render_images(rendered_run.file, SEED, RUN, rendered_run.history, range(TICKS))
    found = np.stack([image for image, _ in images]).astype(float)
    expected = 255.0 * rendered_run.images
    assert expected.std() > 1.0
    # Half a code for rounding, and more where an image is steep, for poses in single precision.
    assert np.quantile(np.abs(found - expected), 0.999) < 0.6
    assert np.abs(found - expected).max() < 3.0
    # Images of another tick differ.
    assert np.abs(found[1:] - expected[:-1]).max() > 10.0


def test_every_image_comes_with_the_channels_of_its_tick(rendered_run: RenderedRun) -> None:
    ((image, channels),) = rerender.render_images(rendered_run.file, SEED, RUN, rendered_run.history, [4])
    assert (image.dtype, image.shape) == (np.uint8, rendered_run.images.shape[1:])
    assert channels["time_s"] == 4.0
    np.testing.assert_array_equal(channels["box_px"], rendered_run.history["box_px"][4])
    assert set(channels) == set(rendered_run.history)


def test_window_lies_in_the_frame(rendered_run: RenderedRun) -> None:
    left, top, side = rendered_run.history["window_px"].T
    assert (left >= 0.0).all()
    assert (top >= 0.0).all()
    assert (side >= rendered_run.images.shape[1]).all()
    assert (side <= 320.0).all()


def test_score_lies_between_0_and_1(rendered_run: RenderedRun) -> None:
    score = rendered_run.history["box_score"]
    assert ((score > 0.0) & (score < 1.0)).all()


def test_history_without_poses_is_refused_with_the_missing_channel(rendered_run: RenderedRun) -> None:
    incomplete = {name: values for name, values in rendered_run.history.items() if name != "q_TN"}
    with pytest.raises(ResultError, match=r"run 3: found no channel 'q_TN'"):
        next(rerender.render_images(rendered_run.file, SEED, RUN, incomplete, [0]))


def test_valid_ticks_end_at_the_failure() -> None:
    assert rerender.valid_tick_count({"time_s": np.arange(4.0), "range_m": np.array([3.0, 2.0, np.nan, np.nan])}) == 2
    assert rerender.valid_tick_count({"time_s": np.arange(2.0), "range_m": np.array([3.0, 2.0])}) == 2


def test_scenario_of_a_campaign_is_read_back(rendered_campaign: Campaign, rendered_run: RenderedRun) -> None:
    found = rendered_campaign.configuration
    assert rerender.rendered_scenario(found.scenario, found.scenario_hash) == rendered_run.file


@pytest.mark.parametrize("model", ["geometric", "statistical"])
def test_camera_without_images_is_refused(model: str) -> None:
    with pytest.raises(RpojaxError, match=f"camera.model: found '{model}', which takes no pictures"):
        rerender.rendered_scenario({"camera": {"model": model}}, "0" * 64)


def test_other_trained_files_than_the_campaigns_are_refused(rendered_campaign: Campaign) -> None:
    with pytest.raises(RpojaxError, match="imaging: found other trained files"):
        rerender.rendered_scenario(rendered_campaign.configuration.scenario, "0" * 64)


def test_images_of_a_team_are_those_of_each_camera(rendered_run: RenderedRun, rendered_pair: RenderedRun) -> None:
    ticks = [0, 4]

    def images(servicer: int) -> np.ndarray:
        own = of_servicer(rendered_pair.history, servicer)
        found = rerender.render_images(rendered_pair.file, SEED, RUN, own, ticks, None, servicer)
        return np.stack([image for image, _ in found]).astype(float)

    alone = rerender.render_images(rendered_run.file, SEED, RUN, rendered_run.history, ticks)
    np.testing.assert_array_equal(images(0), np.stack([image for image, _ in alone]))
    # From the same pose the second camera has its own noise.
    assert np.abs(images(1) - images(0)).max() > 1.0


def test_a_team_without_a_chosen_servicer_is_refused(rendered_run: RenderedRun, rendered_pair: RenderedRun) -> None:
    with pytest.raises(ScenarioError, match=r"servicers: found .2 of them"):
        next(rerender.render_images(rendered_pair.file, SEED, RUN, rendered_run.history, [0]))


def test_valid_ticks_of_a_team_end_at_the_first_failure() -> None:
    ranges = np.array([[3.0, 4.0], [2.0, 4.0], [2.0, np.nan], [np.nan, np.nan]])
    assert rerender.valid_tick_count({"time_s": np.arange(4.0), "range_m": ranges}) == 2
