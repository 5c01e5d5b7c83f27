"""The search of the built site, without a network, leads to the right page."""

import re
from pathlib import Path
from urllib.parse import quote

import pytest
from headless_browser import BROWSER, browse, console_lines, view_options

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="needs Chromium")]


@pytest.mark.parametrize(
    ("query", "page"),
    [
        ("Joseph form", "docs/theory/orbit_filter.html"),
        ("solar pressure", "docs/theory/environment.html"),
        ("keep-out", "docs/theory/passive_safety.html"),
        ("resume", "docs/how_to/large_campaigns.html"),
        ("consumer's risk", "docs/theory/statistics.html"),
        ("own mesh", "docs/how_to/field.html"),
        ("ROS 2", "docs/how_to/ros2.html"),
        ("NEES", "docs/theory/statistics.html"),
        ("look-away", "docs/reference/glossary.html"),
        ("edge_noise_px", "docs/reference/scenario_keys.html"),
        ("formation_error_rms_m", "docs/reference/metrics.html"),
        ("exit status", "docs/reference/command_line.html"),
        ("eclipse", "docs/theory/environment.html"),
        ("burn schedule", "docs/theory/pointing.html"),
        ("covariance", "docs/theory/linear_covariance.html"),
        ("export csv", "docs/how_to/export.html"),
        ("TLE", "docs/reference/scenario.html"),
        ("GPU", "docs/about/performance.html"),
        ("sensitivity", "docs/theory/worst_case.html"),
        ("abort", "docs/theory/missions.html"),
        ("requirement", "docs/reference/glossary.html"),
        ("thruster misalignment", "docs/theory/dynamics.html"),
        ("hold point", "docs/theory/missions.html"),
        ("camera model", "docs/theory/sensors.html"),
        ("custom metric", "docs/how_to/plugins.html"),
        ("Python API", "docs/how_to/python.html"),
        ("failed run", "docs/reference/campaign_folder.html"),
    ],
)
def test_a_search_leads_to_the_page_at_first_place(site: Path, query: str, page: str) -> None:
    assert results(site, query)[0] == page


def test_a_word_that_nobody_uses_leads_nowhere(site: Path) -> None:
    assert results(site, "xylophone") == []


def results(site: Path, query: str) -> list[str]:
    """Pages that the search names, in its order, without the place in the page."""
    shown = browse_search(site, query)
    return [link.partition("#")[0] for link in re.findall(r'<li class="kind-[a-z]+"><a href="([^"]*)"', shown)]


def browse_search(site: Path, query: str) -> str:
    """Document of the search page after the search, with no host name resolved."""
    page = site / "search.html"

    class WithQuery(type(page)):  # the query belongs to the address, not to the file
        def as_uri(self) -> str:
            return f"{super().as_uri()}?q={quote(query)}"

    shown = browse(WithQuery(page), *view_options(1200, 900), "--dump-dom")
    assert not [line for line in console_lines(shown) if "rror" in line]
    return shown.stdout
