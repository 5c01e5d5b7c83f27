"""Bags of a run: image storage, and a run with a rendered camera against the record of its campaign."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rpojax.campaign import rerender
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.ros2 import message_values, run_bag, topics
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario.loading import scenario_loader

RUN = 3
FRAME = ("camera.width_px=320", "camera.height_px=240", "camera.field_of_view_deg=40.0")
"""Larger than the detector's square, so that an image is a window of the frame."""


def test_images_of_a_camera_without_images_are_refused() -> None:
    assert run_bag.resolve_image_storage("geometric", "auto") == ImageStorage.NONE
    assert run_bag.resolve_image_storage("rendered", "auto") == ImageStorage.RAW
    with pytest.raises(RpojaxError, match=r"^images: found 'raw' for camera.model = 'geometric', expected 'none'$"):
        run_bag.resolve_image_storage("geometric", "raw")


def test_compressed_images_are_lossless(burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray) -> None:
    messages = run_bag.run_messages(burn_interval, ImageStorage.COMPRESSED, noise_images)
    compressed = [each.message for each in messages if each.topic is topics.COMPRESSED_IMAGE]
    assert len(compressed) == burn_interval.ticks
    for message, image in zip(compressed, noise_images, strict=True):
        assert message.format == "rgb8; png compressed bgr8"
        np.testing.assert_array_equal(cv2.imdecode(message.data, cv2.IMREAD_COLOR)[:, :, ::-1], image)


@pytest.fixture(scope="module")
def rendered_campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign of that run."""
    file = scenario_loader.load("inspection", ("camera.model=rendered", "duration_s=12", *FRAME))
    out = tmp_path_factory.mktemp("rendered") / "runs"
    return run_campaign(file, 1, out, 5, first_run=RUN, block_size=1, histories=[RUN])


@pytest.fixture(scope="module")
def replayed(rendered_campaign: Campaign) -> ReplayedRun[RosTickValues]:
    """Replay of the same run."""
    return run_replay.replay_servicers(rendered_campaign, RUN, message_values.observe_tick)[0]


@pytest.mark.slow
def test_a_replay_agrees_with_the_record_of_the_campaign(
    rendered_campaign: Campaign, replayed: ReplayedRun[RosTickValues]
) -> None:
    found = run_replay.compare_with_campaign(replayed, rendered_campaign)
    assert found
    assert (found.samples, found.same_end) == (2, True)
    assert found.range_difference_m < 1e-4
    history, image = rendered_campaign.history(RUN), replayed.values.camera
    np.testing.assert_array_equal(history["box_present"], image.present)
    np.testing.assert_array_equal(history["box_accepted"], replayed.values.box_accepted)
    np.testing.assert_allclose(history["box_score"], image.score, atol=1e-3)
    # From pixels of the window to those of the frame.
    corner, binning = history["window_px"][:, :2], history["window_px"][:, 2:] / image.size_px[:, :1]
    low = (np.asarray(image.box_center_px) - 0.5 * np.asarray(image.box_size_px)) * binning + corner
    np.testing.assert_allclose(low, history["box_px"][:, :2], atol=0.05)
    assert binning.max() > 1.2
    focal, center = image.focal_px * binning[:, 0], image.center_px * binning + corner
    np.testing.assert_allclose(focal, focal[0], rtol=1e-6)
    np.testing.assert_allclose(center, np.broadcast_to([160.0, 120.0], center.shape), atol=1e-3)


@pytest.mark.slow
def test_images_agree_with_those_rendered_from_the_history(
    rendered_campaign: Campaign, replayed: ReplayedRun[RosTickValues]
) -> None:
    rendered = rerender.render_images(replayed.file, 5, RUN, rendered_campaign.history(RUN), range(replayed.ticks))
    messages = run_bag.run_messages(replayed, ImageStorage.RAW, run_bag.bag_images(replayed))
    image_messages = [each.message for each in messages if each.topic is topics.IMAGE]
    for message, (image, _) in zip(image_messages, rendered, strict=True):
        height, width, _ = image.shape
        assert (message.height, message.width, message.step, message.encoding) == (height, width, 3 * width, "rgb8")
        difference = message.data.astype(float) - image.reshape(-1)
        assert np.quantile(np.abs(difference), 0.99) <= 1.0
        assert image.std() > 1.0


@pytest.mark.slow
def test_the_command_stores_raw_images_by_default(
    rendered_campaign: Campaign,
    replayed: ReplayedRun[RosTickValues],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (replayed,))
    assert (
        main.main(
            ["export-bag", str(rendered_campaign.directory), "--run-id", str(RUN), "--out", str(tmp_path / "bag")]
        )
        == 0
    )
    assert "12 ticks" in capsys.readouterr().out
    assert (tmp_path / "bag" / "bag.mcap").stat().st_size > 12 * replayed.values.camera.size_px[0].prod() * 3
