"""Boxes counted by hand."""

import json
from typing import Any

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.sections import detection_section


def history(frames: int, range_m: float) -> dict[str, np.ndarray]:
    """Frames that look at a lit target of 20 by 10 px, each with a box that is exactly right and accepted."""
    yes = np.ones(frames, bool)
    outline = np.tile([50.0, 60.0, 20.0, 10.0], (frames, 1))
    return {
        "range_m": np.full(frames, range_m),
        "mode": np.full(frames, Mode.LOOK, np.int8),
        "observable": yes.copy(),
        "box_present": yes.copy(),
        "box_accepted": yes.copy(),
        "box_outlier": ~yes,
        "box_truncated": ~yes,
        "box_px": outline.copy(),
        "box_score": np.full(frames, 0.9),
        "outline_px": outline,
    }


def lines(*histories: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    return detection_section.detections_by_range(histories)


def test_fractions_refer_to_the_right_frames() -> None:
    run = history(100, 30.0)
    run["mode"][:20] = [Mode.TURN] * 8 + [Mode.BURN] * 4 + [Mode.TURN_BACK] * 8
    run["mode"][20:25] = Mode.SEARCH
    run["box_present"][2:20] = False  # two boxes while turned away, one of them false
    run["box_outlier"][0] = True
    run["box_outlier"][[30, 31, 32, 33]] = True
    run["observable"][90:] = False  # no light, no box
    run["box_present"][60:] = False
    run["box_truncated"][40:50] = True
    run["box_accepted"] = run["box_present"] & ~run["box_outlier"]
    (line,) = lines(run)
    assert (line["frames"], line["away_frames"], line["boxes"]) == (70, 20, 42)
    assert line["boxes_per_frame"] == pytest.approx(40 / 70)
    assert line["accepted"] == pytest.approx(37 / 42)
    assert line["false_per_frame"] == pytest.approx(4 / 70)
    assert line["false_per_away_frame"] == pytest.approx(1 / 20)
    assert line["cut"] == pytest.approx(10 / 42)
    assert line["edges"]["boxes"] == 42 - 5 - 10


def test_edge_errors_are_positive_to_the_right_and_down() -> None:
    run = history(1000, 30.0)
    noise = np.random.default_rng(0).normal(size=1000)
    run["box_px"] += np.array([1.0, -2.0, 3.0, 0.5])  # left, top, width, height
    run["box_px"][:, 0] += noise
    run["box_px"][:, 2] -= noise
    edges = lines(run)[0]["edges"]
    bias = [edges[name]["bias_px"] for name in ("left", "top", "right", "bottom")]
    np.testing.assert_allclose(bias, [1.0 + noise.mean(), -2.0, 4.0, -1.5], atol=1e-9)
    assert edges["left"]["sigma_px"] == pytest.approx(noise.std())
    assert edges["right"]["sigma_px"] == pytest.approx(0.0, abs=1e-9)
    assert edges["side_px"] == pytest.approx(np.sqrt(200.0))


def test_overlap_is_intersection_over_union() -> None:
    run = history(30, 30.0)
    run["box_px"][:] = [60.0, 60.0, 20.0, 10.0]
    assert lines(run)[0]["edges"]["overlap"] == pytest.approx(1.0 / 3.0)


def test_ranges_with_enough_frames_have_a_row() -> None:
    found = lines(history(50, 31.0), history(60, 45.0), history(19, 200.0))
    assert [line["range_m"] for line in found] == [None, [30.0, 35.0], [40.0, 50.0]]
    assert [line["frames"] for line in found] == [129, 50, 60]


def test_frames_after_a_failure_are_left_out() -> None:
    run = history(50, 30.0)
    run["range_m"][30:] = np.nan
    assert lines(run)[0]["frames"] == 30


def test_histories_without_outlines_are_left_out() -> None:
    run = history(50, 30.0)
    del run["outline_px"]
    assert lines(run) == []
    assert detection_section.table_cells([]) == {"boxes": [], "edges": []}


def test_dashes_without_boxes() -> None:
    run = history(50, 30.0)
    run["box_present"][:] = run["box_accepted"][:] = False
    cells = detection_section.table_cells(lines(run))
    assert cells["edges"] == []
    assert cells["boxes"][0][:5] == ["all", "50", "0", "0", "0 %"]
    assert set(cells["boxes"][0][9:]) == {"\N{EN DASH}"}


def test_box_statistics_need_scores_and_outlines(campaign):
    words = page_text(rendered_page(campaign))
    assert "No history holds scores and true outlines" in words
    for history in campaign.histories.values():
        history["box_score"] = np.where(history["box_present"], 1.0, 0.0)
        history["outline_px"] = history["box_px"]
    page = rendered_page(campaign)
    assert "False per look-away frame" in page_text(page)
    assert "A box without a detector has the score 1" in page_text(page)
    content = json.loads((campaign.directory / "report.json").read_text())
    assert content["detections"][0]["edges"]["overlap"] == pytest.approx(1.0)
