"""Playback in Chromium: the slider, keys and clicks move pictures, numbers and charts, without console messages."""

import json
import re
from pathlib import Path

import pytest
from headless_browser import BROWSER, browse, console_lines, measure, print_page, view_options
from played_run import add_landmarks, played_campaign
from scipy.spatial.transform import Rotation

from rpojax.report.page.html_report import write_report
from rpojax.report.page.packed_arrays import unpack
from rpojax.report.page.run_playback import playback

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")]
_PROBE = """<script>setTimeout(async () => {
  // A browser without a window that dumps its document shows no frames to wait for.
  window.requestAnimationFrame = (act) => setTimeout(() => act(performance.now()), 16);
  const wait = () => new Promise((done) => setTimeout(done, 400));
  const hash = (canvas) => {
    const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
    const pen = copy.getContext("2d", { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    const data = pen.getImageData(0, 0, copy.width, copy.height).data;
    let [sum, lit] = [0, 0];
    for (let i = 0; i < data.length; i += 4) {
      sum = (sum * 31 + data[i] + 2 * data[i + 1] + 3 * data[i + 2]) % 1000003;
      if (data[i] > 40) lit += 1;
    }
    return [sum, lit];
  };
  const look = () => ({
    time: document.getElementById("play-time").textContent,
    state: Object.fromEntries([...document.querySelectorAll("#play-state div")].map(
      ({ children: [title, text] }) => [title.textContent, text.textContent])),
    canvases: Object.fromEntries(["play-scene", "play-frame", "play-close"].map(
      (id) => [id, hash(document.getElementById(id))])),
    heads: [...document.querySelectorAll("g.playhead line")].map((one) => Number(one.getAttribute("x1"))),
    values: [...document.querySelectorAll('[data-chart="0-range_m"] g.playhead text')].map(
      (one) => one.textContent),
    bars: [...document.querySelectorAll(".timeline .playhead")].map((one) => one.style.left),
  });
  const slider = document.getElementById("play-slider");
  const key = (name, where, more) => where.dispatchEvent(
    new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true, ...more }));
  const found = { charts: document.querySelectorAll('[data-chart]').length, start: look() };
  slider.value = 170;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  await wait();
  found.moved = look();
  key("ArrowRight", slider);
  await wait();
  found.stepped = look();
  key("ArrowLeft", document.body, { shiftKey: true });
  await wait();
  found.back = look();
  key(" ", slider);
  await wait();
  found.playing = document.getElementById("play-button").getAttribute("aria-label");
  key(" ", slider);
  await wait();
  found.paused = look();
  document.querySelector("button.seek").click();
  await wait();
  found.sought = look();
  const place = document.body.appendChild(document.createElement("pre"));
  place.id = "moved";
  place.textContent = JSON.stringify(found);
}, 3000);</script>"""


_TURNING = """<script>
  const corridors = [];
  Playback.onMove((run, seen) => {
    const zone = Playback.zoneOf(seen.servicers[0]);
    corridors.push({ time: seen.now.time, axis: Playback.axisOf(zone.corridor, run, seen) });
  });
  setTimeout(() => {
    const slider = document.getElementById("play-slider");
    slider.value = 140;
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    const state = [...document.querySelectorAll("#play-state div")].map(({ children }) => children[1].textContent);
    const place = document.body.appendChild(document.createElement("pre"));
    place.id = "moved";
    place.textContent = JSON.stringify({ corridor: corridors.at(-1), state });
  }, 3000);
</script>"""


def moved(page: Path, probe: str = _PROBE) -> tuple[dict, list[str]]:
    """What the page shows at its start and after each way to move it, and its console messages."""
    probed = page.with_name("moved.html")
    probed.write_text(page.read_text().replace("</body>", f"{probe}</body>"))
    shown = browse(probed, *view_options(1440, 900), "--dump-dom")
    found = re.search(r'<pre id="moved">(.*?)</pre>', shown.stdout, re.DOTALL)
    assert found is not None, shown.stderr[-2000:]
    return json.loads(found[1]), console_lines(shown)


def test_slider_keys_and_links_move_pictures_numbers_and_charts(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    found, messages = moved(write_report(campaign))
    assert messages == []
    start, after = found["start"], found["moved"]
    assert (start["time"], after["time"]) == ("0 s", "170 s")
    for name, (picture, lit) in after["canvases"].items():
        assert picture != start["canvases"][name][0], name
        assert lit > 50, name
    played = playback(campaign, 0)
    assert played is not None
    distance = float((unpack(played["servicers"][0]["arrays"]["rho_H"])[170] ** 2).sum() ** 0.5)
    assert float(after["state"]["Range"].removesuffix(" m")) == pytest.approx(distance, rel=1e-4)
    assert float(after["values"][0].removesuffix(" m")) == pytest.approx(distance, rel=0.02)
    assert after["state"]["Pointing"] == "turn for a burn"
    assert len(after["heads"]) >= found["charts"] - 3
    assert all(now > before for before, now in zip(start["heads"], after["heads"], strict=True))
    assert set(after["bars"]) == {f"{100 * 170 / 300:.4f}%"}
    assert found["stepped"]["time"] == "171 s"
    assert found["back"]["time"] == "168 s"
    assert found["playing"] == "Pause"
    assert float(found["paused"]["time"].removesuffix(" s")) > 168.0
    assert found["sought"]["time"] != found["paused"]["time"]


def test_a_corridor_in_the_target_frame_turns_with_it(tmp_path) -> None:
    campaign = played_campaign(tmp_path)
    add_landmarks(campaign)
    found, messages = moved(write_report(campaign), _TURNING)
    assert messages == []
    played = playback(campaign, 0)
    assert played is not None
    turn = Rotation.from_quat(unpack(played["scene"]["q_HT"])[140])
    assert found["corridor"]["time"] == 140.0
    assert found["corridor"]["axis"] == pytest.approx(turn.apply([0.0, 0.0, 1.0]), abs=1e-3)
    assert abs(turn.as_matrix()[2, 2]) < 0.97, "it has turned by then"
    assert {"3", "known, off by 2\N{DEGREE SIGN}"} <= set(found["state"])


@pytest.mark.parametrize("width", [400, 1000, 1440, 2000])
def test_the_page_fits_its_window(tmp_path, width: int) -> None:
    page = write_report(played_campaign(tmp_path))
    assert page.stat().st_size < 4e6
    found, messages = measure(page, *view_options(width, 900))
    assert messages == []
    assert found["content"] <= found["width"]
    assert found["undrawn"] == 0
    assert min(found["painted"]) > 1000


def test_paper_has_a_still_picture_and_no_controls(tmp_path) -> None:
    page = write_report(played_campaign(tmp_path))
    assert print_page(page, tmp_path / "run.pdf") >= 3
