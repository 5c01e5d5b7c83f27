"""The command `rpojax film`; here because it shares the rendered run with the tests of this folder."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from empty_campaign_folders import empty_campaign
from rendered_run import RUN, SEED, TICKS, RenderedRun

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def film(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., tuple[int, str]]]:
    """The command in this process: exit status, and standard output or, if it failed, standard error."""
    from rpojax.cli import main

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = main.main(["film", *map(str, words)])
        printed = capsys.readouterr()
        return status, printed.err if status else printed.out

    yield run


def test_film_writes_a_contact_sheet_and_a_film(
    rendered_campaign: Campaign, film: Callable[..., Any], tmp_path: Path
) -> None:
    import cv2

    sheet, movie = tmp_path / "new" / "seen.png", tmp_path / "seen.mp4"
    assert film(rendered_campaign.directory, "--run-id", RUN, "--out", sheet) == (0, f"{sheet}\n")
    assert film(rendered_campaign.directory, "--every", 2, "--out", movie) == (0, f"{movie}\n")
    assert cv2.imread(str(sheet)).shape[1] > 4 * 384
    capture = cv2.VideoCapture(str(movie))
    count = 0
    while capture.read()[0]:
        count += 1
    assert count == TICKS / 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "runs", "seen.mp4"]


def test_the_film_of_a_team_shows_its_cameras_side_by_side(
    rendered_pair: RenderedRun, film: Callable[..., Any], tmp_path: Path
) -> None:
    import cv2

    campaign = empty_campaign(tmp_path / "runs", rendered_pair.file, SEED, 4, 0, 1, [RUN])
    campaign.write_history(RUN, rendered_pair.history)
    movie, sheet = tmp_path / "seen.mp4", tmp_path / "seen.png"
    assert film(campaign.directory, "--every", 5, "--out", movie) == (0, f"{movie}\n")
    frame = cv2.VideoCapture(str(movie)).read()[1]
    assert frame.shape[1] > 2 * 384
    assert film(campaign.directory, "--out", sheet) == (0, f"{sheet}\n")
    assert cv2.imread(str(sheet)).shape[1] > 4 * 384


def test_film_does_not_overwrite(rendered_campaign: Campaign, film: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "mine.png").write_text("mine")
    assert film(rendered_campaign.directory, "--out", tmp_path / "mine.png") == (
        2,
        f"rpojax: error: {tmp_path / 'mine.png'}: exists already; --force replaces it\n",
    )
    assert (tmp_path / "mine.png").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--out", "seen.gif"], "seen.gif: found suffix '.gif', expected .png or .mp4"),
        (["--out", "s.mp4", "--every", "0"], "--every: found 0, expected at least 1"),
        (["--out", "s.mp4", "--run-id", "4"], "--run-id: found 4, expected a run of this campaign, 0 to 3"),
    ],
)
def test_bad_options_are_refused_in_one_line(
    rendered_campaign: Campaign, film: Callable[..., Any], words: list[str], error: str
) -> None:
    assert film(rendered_campaign.directory, *words) == (2, f"rpojax: error: {error}\n")


def test_campaign_without_images_is_refused_in_one_line(
    inspection_file: ScenarioFile, film: Callable[..., Any], tmp_path: Path
) -> None:
    campaign = empty_campaign(tmp_path / "runs", inspection_file, SEED, 4, 0, 1, [])
    status, error = film(campaign.directory, "--out", tmp_path / "seen.mp4")
    assert (status, error.count("\n")) == (2, 1)
    assert "camera.model: found 'geometric', which takes no pictures, expected 'rendered'" in error


def test_output_that_cannot_be_written_is_named(
    rendered_campaign: Campaign, film: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    for name in ("seen.mp4", "seen.png"):
        status, error = film(rendered_campaign.directory, "--out", tmp_path / "file" / name)
        assert status == 2
        assert f"rpojax: error: {tmp_path / 'file' / name}: found " in error
