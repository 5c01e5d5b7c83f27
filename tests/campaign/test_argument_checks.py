"""Refusal of numbers and folders that a campaign cannot use."""

from pathlib import Path

import pytest

from rpojax.campaign import argument_checks
from rpojax.errors import OutputError, RpojaxError


@pytest.mark.parametrize(
    ("numbers", "named"),
    [
        ((0, 0, 0, None), "runs: found 0"),
        ((-3, 0, 0, None), "runs: found -3"),
        ((1, -1, 0, None), "first_run: found -1"),
        ((10, 2**31 - 5, 0, None), "first_run"),
        ((1, 0, -1, None), "seed: found -1"),
        ((1, 0, 2**63, None), "seed"),
        ((1, 0, 0, 0), "block_size: found 0"),
    ],
)
def test_numbers_out_of_range_are_named(numbers: tuple[int, int, int, int | None], named: str) -> None:
    with pytest.raises(RpojaxError, match=f"{named}.*expected a whole number from"):
        argument_checks.check_numbers(*numbers)


def test_numbers_at_the_limits_are_accepted() -> None:
    argument_checks.check_numbers(1, 0, 0, None)
    argument_checks.check_numbers(5, 2**31 - 6, 2**63 - 1, 1)
    with pytest.raises(RpojaxError, match=f"first_run: found {2**31 - 5}"):
        argument_checks.check_numbers(5, 2**31 - 5, 2**63 - 1, 1)


def test_folder_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="expected a folder that can be written to"):
        argument_checks.check_folder(tmp_path / "file" / "deeper" / "runs", force=False)
    with pytest.raises(OutputError, match="expected a folder that is not there yet"):
        argument_checks.check_folder(tmp_path / "file", force=False)


def test_folder_with_missing_parents_is_accepted(tmp_path: Path) -> None:
    argument_checks.check_folder(tmp_path / "some" / "deeper" / "runs", force=False)
    assert list(tmp_path.iterdir()) == []


def test_dangling_link_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="not there yet"):
        argument_checks.check_folder(tmp_path / "link", force=False)
