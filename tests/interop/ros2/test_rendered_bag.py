"""A run whose camera takes pictures, as a campaign flew it and as its bag tells it."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.campaign import rerender
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.ros2 import mcap_sqlite3_writer, message_values, topics
from rpojax.interop.ros2.mcap_sqlite3_writer import ImageStorage
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario import scenario_file

pytestmark = pytest.mark.slow

RUN = 3
FRAME = ("camera.width_px=320", "camera.height_px=240", "camera.field_of_view_deg=40.0")
"""Larger than the detector's square, so that a picture is a window of the frame."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign of that run, as the engine flies it."""
    file = scenario_file.load("inspection", ("camera.model=rendered", "duration_s=12", *FRAME))
    out = tmp_path_factory.mktemp("rendered") / "runs"
    return run_campaign(file, 1, out, 5, first_run=RUN, block_size=1, histories=[RUN])


@pytest.fixture(scope="module")
def again(flown: Campaign) -> ReplayedRun[RosTickValues]:
    """The same run, flown again."""
    return run_replay.replay(flown, RUN, message_values.observe_tick)


def test_a_run_flown_again_is_that_of_the_campaign(flown: Campaign, again: ReplayedRun[RosTickValues]) -> None:
    found = run_replay.compare_with_campaign(again, flown)
    assert found
    assert (found.samples, found.same_end) == (2, True)
    assert found.range_difference_m < 1e-4
    kept, view = flown.history(RUN), again.values.camera
    np.testing.assert_array_equal(kept["box_present"], view.present)
    np.testing.assert_array_equal(kept["box_accepted"], again.values.box_accepted)
    np.testing.assert_allclose(kept["box_score"], view.score, atol=1e-3)
    # Back from pixels of the window to those of the frame.
    corner, binning = kept["window_px"][:, :2], kept["window_px"][:, 2:] / view.size_px[:, :1]
    low = (np.asarray(view.box_center_px) - 0.5 * np.asarray(view.box_size_px)) * binning + corner
    np.testing.assert_allclose(low, kept["box_px"][:, :2], atol=0.05)
    assert binning.max() > 1.2
    focal, middle = again.values.camera.focal_px * binning[:, 0], again.values.camera.center_px * binning + corner
    np.testing.assert_allclose(focal, focal[0], rtol=1e-6)
    np.testing.assert_allclose(middle, np.broadcast_to([160.0, 120.0], middle.shape), atol=1e-3)


def test_its_pictures_are_those_that_a_film_of_the_campaign_shows(
    flown: Campaign, again: ReplayedRun[RosTickValues]
) -> None:
    taken = rerender.render_images(again.file, 5, RUN, flown.history(RUN), range(again.ticks))
    told = mcap_sqlite3_writer.run_messages(again, ImageStorage.RAW, mcap_sqlite3_writer.rerendered_images(again))
    messages = [each.message for each in told if each.topic is topics.IMAGE]
    for message, (picture, _) in zip(messages, taken, strict=True):
        height, width, _ = picture.shape
        assert (message.height, message.width, message.step, message.encoding) == (height, width, 3 * width, "rgb8")
        off = message.data.astype(float) - picture.reshape(-1)
        assert np.quantile(np.abs(off), 0.99) <= 1.0
        assert picture.std() > 1.0


def test_the_verb_stores_the_pictures_by_default(
    flown: Campaign,
    again: ReplayedRun[RosTickValues],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from rpojax.cli import main

    monkeypatch.setattr(run_replay, "replay", lambda *_, **__: again)
    assert main.main(["export-bag", str(flown.directory), "--run-id", str(RUN), "--out", str(tmp_path / "bag")]) == 0
    assert "12 ticks" in capsys.readouterr().out
    assert (tmp_path / "bag" / "bag.mcap").stat().st_size > 12 * again.values.camera.size_px[0].prod() * 3
