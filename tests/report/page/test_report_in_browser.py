"""The report page in Chromium: no errors, no external requests, every chart drawn."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from rpojax.report.page.html_report import write_report

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next((found for name in _NAMES if (found := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")


def _browse(page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Runs the browser on a page: its document on stdout, its console on stderr; no host name resolves."""
    profile = page.parent / "profile"
    quiet = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
    alone = ("--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}", "--enable-logging=stderr")
    command = [str(BROWSER), *quiet, *alone, "--virtual-time-budget=20000", *options, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)


def test_every_chart_is_drawn_without_console_messages(build):
    campaign = build(runs=30, seconds=60, kept=(), failed=(3,))
    campaign.drawn["<img src=http://x>"] = campaign.metrics["delta_v_m_s"].copy()
    campaign.drawn["<img src=http://x>"][3] = 0.3
    page = write_report(campaign)
    shown = _browse(page, "--dump-dom")
    assert [line for line in shown.stderr.splitlines() if "CONSOLE" in line] == []
    assert "<img src=" not in shown.stdout.partition("<script")[0]
    places = len(re.findall(r'data-chart="', shown.stdout))
    assert places > 20
    others = len(re.findall(r'id="detail-|id="(?:rank|scatter)-chart', shown.stdout))
    assert len(re.findall(r'data-drawn="yes"', shown.stdout)) == places + others
    assert shown.stdout.count("<option") > 10


def test_external_requests_are_detected(build):
    page = write_report(build(runs=3, seconds=30, kept=()))
    page.write_text(page.read_text().replace("</main>", '<img src="https://example.org/x.png"></main>'))
    shown = _browse(page, "--dump-dom")
    assert any("CONSOLE" in line and "example.org" in line for line in shown.stderr.splitlines())


@pytest.mark.slow
def test_page_prints_to_pdf(build, tmp_path):
    page = write_report(build(runs=30, seconds=60, kept=(0,)))
    paper = tmp_path / "report.pdf"
    _browse(page, f"--print-to-pdf={paper}", "--no-pdf-header-footer")
    content = paper.read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", content)) >= 5
