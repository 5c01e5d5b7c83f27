"""Figures of the paper for one run: files, titles, unusual runs."""

import numpy as np
import pytest
from matplotlib.image import imread

from rpojax.report.figures.paper_figures import (
    FIGURES,
    write_figures,
)


@pytest.mark.parametrize("failed", [(), (0,)])
def test_figures_are_written_and_not_empty(build, tmp_path, failed):
    paths = write_figures(build(failed=failed).history(0), tmp_path / "figures", "inspection, run 0")
    assert list(paths) == ["bearing_and_range.png", "estimation_error.png", "relative_position.png"] == list(FIGURES)
    for path in paths.values():
        pixels = imread(path)
        assert pixels.shape[0] > 600
        assert pixels.shape[1] > 1200
        assert 0.01 < np.mean(pixels[..., :3].min(axis=2) < 0.8) < 0.6


@pytest.mark.parametrize("name", [r"$\foo$", "a $ and a {", "$$"])
def test_scenario_names_with_dollar_signs_are_not_formulas(campaign, tmp_path, name):
    paths = write_figures(campaign.history(0), tmp_path, name)
    assert all(path.stat().st_size for path in paths.values())


def test_titles_name_the_figure_of_the_paper_and_the_run(campaign, tmp_path, monkeypatch):
    titles = []
    monkeypatch.setattr(
        "rpojax.report.figures.png_export.png_bytes", lambda figure: titles.append(figure.get_suptitle()) or b""
    )
    write_figures(campaign.history(0), tmp_path, "inspection, run 0")
    assert titles[0] == "Bearing and range (as Figure 6 of the paper): inspection, run 0"
    assert [title.partition("Figure ")[2][0] for title in titles] == ["6", "7", "8"]


def test_run_without_boxes_is_drawn(campaign, tmp_path):
    history = dict(campaign.history(0))
    history["box_present"] = np.zeros_like(history["box_present"])
    history["mode"] = np.full_like(history["mode"], 4)
    assert len(write_figures(history, tmp_path, "no box")) == 3
