"""The report page in Chromium: no errors, no external requests, every chart drawn."""

import re

import pytest
from headless_browser import BROWSER, browse, console_lines, measure, view_options
from probability_estimates import write_estimate

from rpojax.report.page.html_report import write_report

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")


def test_every_chart_is_drawn_without_console_messages(build):
    campaign = build(runs=30, seconds=60, kept=(), failed=(3,))
    campaign.drawn["<img src=http://x>"] = campaign.metrics["delta_v_m_s"].copy()
    campaign.drawn["<img src=http://x>"][3] = 0.3
    page = write_report(campaign)
    shown = browse(page, "--dump-dom")
    assert console_lines(shown) == []
    assert "<img src=" not in shown.stdout.partition("<script")[0]
    places = len(re.findall(r'data-chart="', shown.stdout))
    assert places > 20
    others = len(re.findall(r'id="detail-|id="(?:rank|scatter)-chart', shown.stdout))
    assert len(re.findall(r'data-drawn="yes"', shown.stdout)) == places + others
    assert shown.stdout.count("<option") > 10


def test_external_requests_are_detected(build):
    page = write_report(build(runs=3, seconds=30, kept=()))
    page.write_text(page.read_text().replace("</main>", '<img src="https://example.org/x.png"></main>'))
    shown = browse(page, "--dump-dom")
    assert any("example.org" in line for line in console_lines(shown))


def test_the_main_part_of_an_estimate_stands_beside_its_contents_on_a_wide_screen(tmp_path):
    found, messages = measure(write_estimate(tmp_path), *view_options(1400, 900))
    assert messages == []
    assert found["main"] == [pytest.approx(1120, abs=1)]
    assert (found["charts"], found["undrawn"]) == (3, 0)
