"""The report page in Chromium: no errors, no external requests, every chart drawn."""

import json
import re

import numpy as np
import pytest
from headless_browser import BROWSER, after_script, browse, console_lines, measure, view_options
from probability_estimates import write_estimate
from report_page_parser import ReportPage

from rpojax.report.page.html_report import write_report

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")


def test_every_chart_is_drawn_without_console_messages(build):
    campaign = build(runs=30, seconds=60, kept=(), failed=(3,))
    campaign.drawn["<img src=http://x>"] = campaign.metrics["delta_v_m_s"].copy()
    campaign.drawn["<img src=http://x>"][3] = 0.3
    # So many runs drift away that axes are logarithmic.
    campaign.traces["range_m"][:12] *= np.linspace(1.0, 300.0, campaign.traces["range_m"].shape[1])
    campaign.metrics["formation_error_rms_m"][:12] *= 2000.0
    page = write_report(campaign)
    charts = json.loads(ReportPage(page.read_text()).data)["charts"]
    assert charts["envelope-range_m"]["layout"]["yaxis"]["type"] == "log"
    assert charts["histogram-formation_error_rms_m"]["layout"]["xaxis"]["type"] == "log"
    shown = browse(page, "--dump-dom")
    assert console_lines(shown) == []
    assert "<img src=" not in shown.stdout.partition("<script")[0]
    places = len(re.findall(r'data-chart="', shown.stdout))
    assert places > 20
    others = len(re.findall(r'id="detail-|id="(?:rank|scatter)-chart', shown.stdout))
    drawn = len(re.findall(r'data-drawn="yes"', shown.stdout))
    assert 3 <= drawn < places + others, "what is folded is drawn when it is opened"
    found, messages = measure(page, opened=True)
    assert messages == []
    assert (found["charts"], found["undrawn"]) == (places + others, 0)
    assert shown.stdout.count("<option") > 10


def test_what_overlaps_or_is_cut_off_is_found(build):
    page = write_report(build(runs=3, seconds=30, kept=()))
    over = '<p style="margin-bottom: -1.2em">one</p><p>two</p><div style="width: 3000px">wide</div>'
    page.write_text(page.read_text().replace("</main>", f"{over}</main>"))
    found, _ = measure(page)
    assert "P one / P two" in found["crossed"]
    assert any("wide" in each for each in found["outside"])


def test_a_run_that_is_picked_is_marked_everywhere_and_opens(build):
    campaign = build(runs=30, seconds=60, kept=(0, 1, 2), failed=(3,))
    campaign.info["scenario"]["requirements"] = [
        {"metric": "delta_v_m_s", "bound": "at most", "limit": 0.001, "probability": 0.9, "consumer_risk": 0.1}
    ]
    script = """
      const state = () => ({
        head: document.querySelector(".run-panel").innerText.split("\\n")[0].trim(),
        text: document.querySelector(".run-panel").textContent, rows: document.querySelectorAll("tr.marked").length,
        charts: document.querySelectorAll("g.picked > *").length, beside: document.getElementById("pick-run").value,
        code: document.querySelector(".run-panel code").textContent,
      });
      const click = (place, across, down) => {
        const box = place.getBoundingClientRect();
        const at = { clientX: box.left + across * box.width, clientY: box.top + down * box.height, bubbles: true };
        place.dispatchEvent(new MouseEvent("click", at));
      };
      for (const details of document.querySelectorAll("main details")) details.open = true;
      await pause(1500);
      document.querySelector('#failures tr[data-pick="3"] td').click();
      const failed = state();
      Runs.mark(0);
      const kept = state();
      const bar = document.querySelector('[data-chart="histogram-delta_v_m_s"] svg.plot');
      click(bar, 0.5, 0.5);
      const ofBar = state();
      click(document.querySelector('[data-chart="envelope-formation_error_m"] svg.plot'), 0.5, 0.4);
      const ofLine = state();
      click(document.querySelector("#scatter-chart svg.plot"), 0.5, 0.5);
      const headings = [...document.querySelectorAll("#metrics th button.sort")];
      const first = () => document.querySelector("#metrics tbody th").textContent.trim();
      const before = first();
      headings[2].click();
      const sorted = [before, first(), headings[2].parentElement.getAttribute("aria-sort")];
      const copies = document.querySelectorAll("main button.copy").length;
      const missing = [...document.querySelectorAll("main code")].filter((one) => (
        /^rpojax /.test(one.textContent.trim()) && !one.nextElementSibling?.classList.contains("copy"))).length;
      return { failed, kept, ofBar, ofLine, sorted, copies, missing };
    """
    found, messages = after_script(write_report(campaign), script, *view_options(1440, 900))
    assert messages == []
    assert "entered the keep-out sphere since 30 s" in found["failed"]["text"]
    assert found["failed"]["rows"] >= 1
    assert found["failed"]["code"] == f"rpojax rerun {campaign.directory} --run-id 3 --out run_3"
    assert "over time" in found["kept"]["text"]
    assert "over time" not in found["failed"]["text"]
    assert found["kept"]["beside"] == "0"
    assert found["kept"]["charts"] > 10, "lines, courses and rings in the charts"
    assert re.search(r"\d+ runs here: ", found["ofBar"]["text"])
    assert found["ofLine"]["charts"] > 10
    before, after, direction = found["sorted"]
    assert before != after
    assert direction == "descending"
    assert found["copies"] > 3
    assert found["missing"] == 0


def test_labels_in_charts_end_within_them(build):
    campaign = build(runs=9, failed=(4,), kept=())
    # From just before the middle of a narrow chart the words would go on beyond its right edge.
    campaign.failed_at_s[4] = 0.48 * campaign.trace_time_s[-1]
    script = """
      const cut = [...document.querySelectorAll("svg.plot")].flatMap((plot) => {
        const { left, right } = plot.getBoundingClientRect();
        return [...plot.querySelectorAll("text.mark")].filter((text) => {
          const box = text.getBoundingClientRect();
          return box.left < left - 0.5 || box.right > right + 0.5;
        }).map((text) => text.textContent);
      });
      const words = [...document.querySelectorAll("text.mark")].map((text) => text.textContent).join(" ");
      return { cut, words };
    """
    found, messages = after_script(write_report(campaign), script, *view_options(400, 900))
    assert messages == []
    assert "run 4: entered the keep-out sphere" in found["words"]
    assert found["cut"] == []


def test_a_link_opens_the_section_that_it_leads_to(build):
    page = write_report(build(runs=30, seconds=60, kept=()))
    script = """
      const fold = document.querySelector("#consistency > details");
      const before = fold.open;
      document.querySelector('a[href="#consistency"]').click();
      await pause(500);
      const drawn = [...fold.querySelectorAll(".chart")].map((one) => one.dataset.drawn);
      return { before, after: fold.open, drawn };
    """
    found, messages = after_script(page, script)
    assert messages == []
    assert (found["before"], found["after"]) == (False, True)
    assert found["drawn"]
    assert set(found["drawn"]) == {"yes"}


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
