"""The folder of an estimate keeps margins to the bit, and refuses what was not written by it."""

import json
from pathlib import Path

import numpy as np
import pytest

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints
from rpojax.analysis.reliability.simulated_failures.estimate_folder import EstimateFolder
from rpojax.errors import OutputError, ResultError

CONFIGURATION = {"seed": 1, "scenario": {"name": "inspection"}}


def points(count: int) -> LatentPoints:
    """Points with two noise keys."""
    rng = np.random.default_rng(count)
    return LatentPoints(rng.standard_normal((count, 3)), rng.integers(0, 99, (count, 2), dtype=np.uint32))


def begun(directory: Path) -> EstimateFolder:
    """Folder in which margins of seven points are kept, one of them infinite and one undefined."""
    folder = EstimateFolder(directory)
    folder.begin(CONFIGURATION, force=False)
    values = np.array([0.1, -0.0, np.inf, -np.inf, np.nan, 1e-300, 2.0 / 3.0])
    np.testing.assert_array_equal(folder.cached(lambda _: values)(points(7)), values)
    return folder


def test_margins_are_taken_from_the_folder_to_the_bit(tmp_path: Path) -> None:
    begun(tmp_path / "a")
    again = EstimateFolder(tmp_path / "a")
    again.begin(CONFIGURATION, force=False)

    def simulated(_: LatentPoints) -> np.ndarray:
        raise AssertionError("simulated again")

    found = again.cached(simulated)(points(7))
    expected = np.array([0.1, -0.0, np.inf, -np.inf, np.nan, 1e-300, 2.0 / 3.0])
    assert found.tobytes() == expected.tobytes()


def test_margins_of_other_points_are_refused(tmp_path: Path) -> None:
    folder = begun(tmp_path / "a")
    with pytest.raises(ResultError, match="margins of other points"):
        EstimateFolder(folder.directory).cached(lambda _: np.zeros(7))(
            LatentPoints(points(7).x + 1e-15, points(7).keys)
        )


@pytest.mark.parametrize("content", ["{}", "[1]", "nothing", '{"margins": [], "points_sha256": "", "sha256": "0"}'])
def test_spoilt_margins_are_refused_in_one_line(tmp_path: Path, content: str) -> None:
    folder = begun(tmp_path / "a")
    (folder.directory / "evaluations" / "000000.json").write_text(content)
    with pytest.raises(ResultError) as error:
        EstimateFolder(folder.directory).cached(lambda _: np.zeros(7))(points(7))
    assert "\n" not in str(error.value)


def test_a_changed_digit_is_noticed(tmp_path: Path) -> None:
    folder = begun(tmp_path / "a")
    folder.write("probability.json", {"probability": 0.125})
    path = folder.directory / "probability.json"
    path.write_text(path.read_text().replace("0.125", "0.126"))
    with pytest.raises(ResultError, match="does not match its digest"):
        folder.read("probability.json")


def test_links_that_lead_elsewhere_are_refused(tmp_path: Path) -> None:
    folder = begun(tmp_path / "a")
    (tmp_path / "elsewhere.json").write_text(json.dumps({}))
    (folder.directory / "probability.json").symlink_to(tmp_path / "elsewhere.json")
    with pytest.raises(ResultError, match="link that leads elsewhere"):
        folder.read("probability.json")
    with pytest.raises(ResultError, match="link that leads elsewhere"):
        folder.write("probability.json", {})


def test_another_estimate_is_not_continued(tmp_path: Path) -> None:
    folder = begun(tmp_path / "a")
    other = {**CONFIGURATION, "seed": 2}
    with pytest.raises(OutputError, match="another seed"):
        EstimateFolder(folder.directory).begin(other, force=False)
    EstimateFolder(folder.directory).begin(other, force=True)
    assert list((folder.directory / "evaluations").iterdir()) == []


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="expected an empty folder"):
        EstimateFolder(tmp_path).begin(CONFIGURATION, force=True)
    assert (tmp_path / "notes.txt").read_text() == "mine"
