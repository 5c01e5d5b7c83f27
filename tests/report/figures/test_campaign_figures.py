"""Figures of `campaign.plot`: units, limits, scales that a few runs do not flatten, and unknown names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing
from matplotlib.figure import Figure

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.report.figures import campaign_figures
from rpojax.report.figures.axis_scale import axis_ends
from rpojax.scenario.loading import scenario_loader


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Six runs, of which every second has failed, and a history of the first."""
    file = scenario_loader.load("inspection")
    found = empty_campaign(tmp_path_factory.mktemp("figures") / "runs", file, 0, 6, 0, 2, history_ids=[0])
    for block in range(3):
        found.write_block(block, synthetic_block(block), synthetic_timing())
    time_s = np.arange(5.0)
    found.write_history(0, {"time_s": time_s, "rho_H": np.stack([0 * time_s, -50 + time_s, time_s], axis=1)})
    return Campaign(found.directory)


def texts(figure: Figure) -> str:
    """Titles, labels and legend of a figure."""
    legend = [text.get_text() for each in figure.legends for text in each.get_texts()]
    axes = [
        part for each in figure.axes for part in (each.get_xlabel(), each.get_ylabel(), each.get_title(loc="right"))
    ]
    return " | ".join([figure.get_suptitle(), *axes, *legend])


def test_an_envelope_has_units_and_the_limits_of_requirements(campaign: Campaign) -> None:
    found = texts(campaign.plot.envelope("range_m"))
    assert "inspection: Range between the spacecraft (6 runs, 3 failed)" in found
    assert "time [s] | range_m [m]" in found
    assert {"median", "90 % of runs", "failed runs"} <= {*found.split(" | ")}
    assert "limit" in found


def test_a_histogram_counts_what_has_no_value(campaign: Campaign) -> None:
    found = texts(campaign.plot.histogram("min_range_m"))
    assert "min_range_m [m] | runs | 3 without a value" in found
    assert "limit" in found


def test_a_point_a_run_of_a_metric_and_a_dispersed_number(campaign: Campaign) -> None:
    found = texts(campaign.plot.scatter("target.tumble_axis[1]", "min_range_m"))
    assert "target.tumble_axis[1] | Minimum range [m]" in found
    assert "not failed" in found


def test_paths_are_around_the_target_with_its_keep_out_sphere(campaign: Campaign) -> None:
    found = texts(campaign.plot.path())
    assert "y, along the track [m] | x, radial [m]" in found
    assert {"run", "start", "target"} <= {*found.split(" | ")}
    assert "keep-out, 10 m" in found


def test_a_notebook_shows_a_figure(campaign: Campaign) -> None:
    assert campaign.plot.path(0)._repr_png_().startswith(b"\x89PNG")  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda plot: plot.envelope("rnge_m"), "channel: found 'rnge_m', expected .*did you mean 'range_m'"),
        (lambda plot: plot.histogram("xyz"), "metric: found 'xyz', expected one of min_range_m"),
        (lambda plot: plot.scatter("min_range_m", "?"), r"y: found '\?', expected one of "),
        (lambda plot: plot.path(7), "run 7: found no history"),
        (lambda plot: plot.envelope("range_m", servicer="bogus"), "servicer: found 'bogus', expected none, as the"),
        (lambda plot: plot.envelope("range_m", servicer=1), "servicer: found 1, expected none"),
        (lambda plot: plot.path([True]), r"run_ids: found \[True\], expected a number"),
        (lambda plot: plot.path(np.array([[0]])), r"run_ids: found array\(\[\[0\]\]\), expected a number"),
    ],
)
def test_an_unknown_name_is_one_line(campaign: Campaign, draw: Callable[..., Figure], message: str) -> None:
    with pytest.raises(RpojaxError, match=message) as caught:
        draw(campaign.plot)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("run_ids", [np.int64(0), np.array(0), np.array([0]), (0, 0), {0}, range(1)])
def test_runs_are_numbers_of_python_or_numpy(campaign: Campaign, run_ids: Any) -> None:
    assert "paths in the Hill frame, run 0" in texts(campaign.plot.path(run_ids))


@pytest.mark.parametrize("run_ids", ["0", 0.0, None, [0.0], [[0]]])
def test_what_is_no_number_of_a_run_is_refused(run_ids: object) -> None:
    with pytest.raises(RpojaxError, match=r"^run_ids: found .*, expected a number of a run or several$"):
        campaign_figures._run_numbers(run_ids)


@pytest.mark.parametrize("name", [["range_m"], {}, 3])
def test_what_is_no_name_is_refused(name: object) -> None:
    with pytest.raises(RpojaxError, match=r"^x: found .*, expected one of "):
        campaign_figures._known("x", name, {"range_m": np.zeros(3)})


def test_a_few_runs_far_away_do_not_set_the_scale() -> None:
    values = np.concatenate([np.linspace(0.0, 1.0, 97), [500.0, 600.0, np.nan]])
    assert axis_ends(values, [2.0]) == (0.0, 2.0)
    halves = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(500.0, 501.0, 50)])
    assert axis_ends(halves, []) == (0.0, 501.0)


def test_the_summary_says_how_the_runs_ended_and_where_they_are(campaign: Campaign) -> None:
    shown = repr(campaign)
    assert shown.startswith("Campaign inspection: 6 runs of 6000 s, seed 0")
    assert "3 completed, 3 keep_out" in shown
    assert str(campaign.directory) in shown


def test_a_campaign_without_runs_is_described_and_draws_nothing(tmp_path: Path) -> None:
    empty = empty_campaign(tmp_path / "runs", scenario_loader.load("inspection"), 0, 6, 0, 2)
    assert "0 of 6 runs, unfinished" in repr(empty)
    with pytest.raises(RpojaxError, match="no run is finished yet"):
        empty.plot.envelope("range_m")
