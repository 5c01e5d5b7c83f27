"""All pages on a desktop, on a phone, in the dark and on paper: no console message, no clipped table, small files.

Pictures are left in the folder that RPOJAX_SCREENSHOTS names, if it is set.
"""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import headless_browser
import numpy as np
import pytest
from PIL import Image
from probability_estimates import write_estimate
from synthetic_campaign_results import SyntheticCampaign, synthetic_campaign

from rpojax.analysis.statistics.campaign_comparison import CampaignComparison, KeyChange
from rpojax.analysis.statistics.paired_comparison import RunMetrics, compare_paired_runs
from rpojax.report.page.brief_page import write_brief
from rpojax.report.page.comparison_page import write_comparison
from rpojax.report.page.html_report import write_report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(headless_browser.BROWSER is None, reason="no Chromium is installed"),
]
VIEWS = {
    "desktop": (1440, 1000, False),
    "wide": (2000, 1000, False),
    "tablet": (1000, 1000, False),
    "phone": (400, 844, False),
    "dark": (1440, 1000, True),
}
MAX_BYTES = 4e6
MAX_FOLDED_PX = 12_000
"""Height of the page of a campaign on a desktop and on a phone, before anything is opened."""


def _campaign(folder: Path, **choices: object) -> SyntheticCampaign:
    """Campaign with requirements that are verified, open and broken, failed runs and a keep-out sphere."""
    campaign = synthetic_campaign(folder, **choices)  # pyright: ignore[reportArgumentType]
    runs = len(campaign.completed)
    rng = np.random.default_rng(3)
    campaign.metrics["passive_range_24_h_m"] = rng.lognormal(2.5, 0.3, runs)
    if runs > 20:  # a few runs drift kilometres away
        campaign.metrics["formation_error_rms_m"][[1, 9, 11]] = 900.0, 2100.0, 5400.0
        campaign.traces["range_m"][[1, 9, 11]] *= np.linspace(1.0, 80.0, campaign.traces["range_m"].shape[1])
    common = {"probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"] |= {
        "safety": {"horizons": ["24_h"]},
        "requirements": [
            {"metric": "formation_error_rms_m", "bound": "at most", "limit": 3.0, **common},
            {"metric": "nav_relative_position_error_rms_m", "bound": "at most", "limit": 0.2, **common},
            {"metric": "min_range_m", "bound": "at least", "limit": 15.0, **common},
            {"metric": "wheel_speed_peak_fraction", "bound": "at most", "limit": 0.8, **common, "probability": 0.999},
        ],
        "target": {"hull_m": [[x, y, z] for x in (-0.3, 0.3) for y in (-0.8, 0.8) for z in (-0.3, 0.3)]},
    }
    return campaign


def _compared(folder: Path) -> Path:
    campaigns = [_campaign(folder / name, runs=60, kept=()) for name in ("before", "after", "later")]
    for number, campaign in enumerate(campaigns):
        campaign.metrics["delta_v_m_s"] = campaign.metrics["delta_v_m_s"] * (1.0 + 0.1 * number)
    runs = [RunMetrics(each.run_ids, each.outcomes, each.metrics) for each in campaigns]
    changed = (KeyChange("navigation.gate_sigma", 3.0, 4.0),)
    found = [
        CampaignComparison(
            *(campaigns[0].directory, campaigns[number].directory, changed, True, ("durations differ",)),
            compare_paired_runs(runs[0], runs[number], [], True),
        )
        for number in (1, 2)
    ]
    return write_comparison(campaigns, found, folder / "comparison.html")


PAGES: dict[str, Callable[[Path], Path]] = {
    "campaign": lambda folder: write_report(_campaign(folder, runs=300, seconds=3000, kept=(0, 1, 2), failed=(3, 7))),
    "run": lambda folder: write_report(_campaign(folder, runs=1, seconds=3000, kept=(0,))),
    "brief": lambda folder: write_brief(_campaign(folder, runs=300, seconds=3000, kept=(0, 1, 2), failed=(3, 7))),
    "comparison": _compared,
    "probability": lambda folder: write_estimate(folder.parent),
}
LEAST_CHARTS = {"probability": 3}
"""Charts of a page, where it has fewer than six."""
CONTENTS_PX = 220
"""Width of the contents beside the main part of a wide page."""


@pytest.fixture(scope="module", params=list(PAGES))
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    made = PAGES[request.param](folder / "results")
    return made.rename(folder / f"{request.param}.html")


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = Path(os.environ.get("RPOJAX_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.mark.parametrize("view", VIEWS)
def test_page_is_whole_in_every_view(page: Path, pictures: Path, view: str) -> None:
    width, height, dark = VIEWS[view]
    options = headless_browser.view_options(width, height, dark)
    found, messages = headless_browser.measure(page, *options)
    assert messages == []
    assert page.stat().st_size < MAX_BYTES
    assert found["charts"] >= LEAST_CHARTS.get(page.stem, 6)
    assert found["undrawn"] == 0
    assert all(painted > 300 for painted in found["painted"])
    assert found["height"] < MAX_FOLDED_PX or page.stem != "campaign"
    is_brief = page.stem == "brief"
    if not is_brief:  # its sheets have the width of paper
        assert found["content"] <= found["width"], "the page itself does not scroll sideways"
        beside = CONTENTS_PX if width >= 1320 else 0
        assert found["main"] == [pytest.approx(min(1120, found["width"] - beside), abs=1)]
    for table in found["tables"]:
        clipped = table["excess"] > 1 and not table["scrolls"]
        assert not clipped, table
        assert is_brief or (table["excess"] > 1) <= table["hinted"], table
    red, green, blue = map(int, found["paper"].removeprefix("rgb(").removesuffix(")").split(",")[:3])
    if not is_brief:
        assert (max(red, green, blue) < 60) == dark
    picture = pictures / f"{page.stem}_{view}.png"
    headless_browser.take_picture(page, picture, *options)
    with Image.open(picture) as image:
        assert image.size == (width, height)
        assert np.asarray(image.convert("L")).std() > 10.0, "the picture is not empty"


@pytest.fixture(scope="module")
def campaign_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return PAGES["campaign"](tmp_path_factory.mktemp("whole") / "results")


@pytest.mark.parametrize("opened", [False, True])
@pytest.mark.parametrize("view", VIEWS)
def test_nothing_of_a_campaign_is_cut_off_or_overlaps(campaign_page: Path, view: str, opened: bool) -> None:
    width, height, dark = VIEWS[view]
    options = headless_browser.view_options(width, height, dark)
    found, messages = headless_browser.measure(campaign_page, *options, opened=opened)
    assert messages == []
    assert found["undrawn"] == 0
    assert (found["height"] > MAX_FOLDED_PX) == opened
    assert (found["outside"], found["clipped"], found["crossed"]) == ([], [], [])


def test_sheets_of_the_brief_report_hold_all_that_is_on_them(page: Path) -> None:
    found, _ = headless_browser.measure(page, *headless_browser.view_options(1000, 1200))
    assert len(found["sheets"]) == (4 if page.stem == "brief" else 0)
    assert all(room >= 0.0 for room in found["sheets"]), found["sheets"]


def test_page_prints_within_its_margins_with_page_numbers(page: Path, pictures: Path) -> None:
    paper = pictures / f"{page.stem}.pdf"
    pages = headless_browser.print_page(page, paper)
    assert pages == 4 if page.stem == "brief" else (1 if page.stem == "probability" else 4) < pages < 40
    if shutil.which("pdftoppm") is None or shutil.which("pdftotext") is None:
        pytest.skip("poppler is not installed, so the PDF file is not looked at")
    words = subprocess.run(["pdftotext", "-layout", str(paper), "-"], capture_output=True, text=True, check=True).stdout
    sheets = words.split("\f")[:pages]
    for number, sheet in enumerate(sheets, start=1):
        assert f"page {number} of {pages}" in sheet
        assert "scenario 3f6c0a9d51e2" in sheet
    subprocess.run(["pdftoppm", "-r", "40", "-gray", "-png", str(paper), str(paper.with_suffix(""))], check=True)
    for picture in sorted(pictures.glob(f"{page.stem}-*.png")):
        with Image.open(picture) as image:
            grey = np.asarray(image)
        margin = round(6 / 25.4 * 40)
        assert (grey[:, -margin:] > 240).all(), f"{picture.name}: something reaches into the right margin"
