"""Chromium without a window: document and console of a page, measures of its layout, pictures and PDF."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next((found for name in _NAMES if (found := shutil.which(name))), None)
_QUIET = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
_OPEN = """<script>setTimeout(() => {
  for (const details of document.querySelectorAll("main details")) details.open = true;
}, 3000);</script>"""
_PROBE = """<script>setTimeout(() => {
  const shown = (one) => one.checkVisibility();
  const width = document.documentElement.clientWidth;
  const named = (one) => `${one.tagName} ${one.textContent.trim().slice(0, 60)}`;
  const whole = [...document.querySelectorAll("main *")].filter((one) => (
    shown(one) && (one.tagName === "text" || !one.closest("svg")) && !one.closest(".wide, pre, .timeline .words")));
  const outside = whole.filter((one) => {
    const box = one.getBoundingClientRect();
    return box.right > width + 1 || box.left < -1;
  });
  const clipped = whole.filter((one) => (
    !one.closest("svg") && one.clientWidth > 0 && one.scrollWidth > one.clientWidth + 1
      && getComputedStyle(one).display !== "inline"));
  const shared = (a, b, from, to) => Math.min(a[to], b[to]) - Math.max(a[from], b[from]);
  const meet = (a, b) => shared(a, b, "left", "right") > 2 && shared(a, b, "top", "bottom") > 3;
  const crossed = [];
  function cross(parts, back) {
    const boxes = parts.map((one) => one.getBoundingClientRect());
    parts.forEach((one, index) => {
      for (let other = Math.max(0, index - back); other < index; other += 1) {
        if (one.contains(parts[other]) || parts[other].contains(one) || !meet(boxes[index], boxes[other])) continue;
        crossed.push(`${named(parts[other])} / ${named(one)}`);
      }
    });
  }
  for (const plot of document.querySelectorAll("svg.plot")) {
    if (shown(plot)) cross([...plot.querySelectorAll("text")], 100);
  }
  const kinds = "p, h1, h2, h3, td, th, .tile, figure, summary, dd, dt, button, canvas, li";
  const blocks = [...document.querySelectorAll(`main :is(${kinds})`)];
  cross(blocks.filter((one) => shown(one) && !one.closest(".wide, svg")), 40);
  const tables = [...document.querySelectorAll("table")].filter(shown).map((table) => {
    const holder = table.closest(".wide, .sheet, section");
    const style = getComputedStyle(holder);
    return {
      table: table.tHead ? table.tHead.textContent.trim().slice(0, 30) : "",
      excess: table.getBoundingClientRect().right - holder.getBoundingClientRect().right,
      scrolls: style.overflowX === "auto", hinted: holder.classList.contains("scrolls"),
    };
  });
  const found = {
    outside: outside.map(named), clipped: clipped.map(named), crossed, height: document.documentElement.scrollHeight,
    width, content: document.documentElement.scrollWidth, tables,
    sheets: [...document.querySelectorAll(".sheet")].map((sheet) => {
      const foot = sheet.querySelector(".sheet-foot").getBoundingClientRect().top;
      const parts = [...sheet.children].filter((one) => !one.classList.contains("sheet-foot"));
      return foot - Math.max(...parts.map((one) => one.getBoundingClientRect().bottom));
    }),
    main: [...document.querySelectorAll("main")].map((one) => one.getBoundingClientRect().width),
    undrawn: [...document.querySelectorAll(".chart")].filter((one) => shown(one) && one.dataset.drawn !== "yes").length,
    charts: document.querySelectorAll(".chart").length, paper: getComputedStyle(document.body).backgroundColor,
    ink: getComputedStyle(document.body).color,
    painted: [...document.querySelectorAll("canvas")].map((one) => {
      const data = one.getContext("2d").getImageData(0, 0, one.width, one.height).data;
      return data.filter((value, index) => index % 4 === 3 && value > 0).length;
    }),
  };
  const place = document.body.appendChild(document.createElement("pre"));
  place.id = "probe";
  place.textContent = JSON.stringify(found);
}, 6000);</script>"""


def browse(page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Runs the browser on a page: its document on stdout, its console on stderr; no host name resolves."""
    alone = ("--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={page.parent / 'profile'}")
    command = [str(BROWSER), *_QUIET, *alone, "--enable-logging=stderr", "--virtual-time-budget=20000", *options]
    return subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=300, check=True)


def console_lines(shown: subprocess.CompletedProcess[str]) -> list[str]:
    """Messages of the page's console."""
    return [line for line in shown.stderr.splitlines() if "CONSOLE" in line]


def view_options(width: int, height: int, dark: bool = False) -> list[str]:
    """Options for a window of a size in pixels, in the light or the dark scheme."""
    return [f"--window-size={width},{height}", f"--blink-settings=preferredColorScheme={0 if dark else 1}"]


def measure(page: Path, *options: str, opened: bool = False) -> tuple[dict[str, Any], list[str]]:
    """Measures of the layout of a page, and its console messages; with `opened`, of all that is folded, too."""
    probed = page.with_name(f"probed_{page.name}")
    probed.write_text(page.read_text().replace("</body>", f"{_OPEN if opened else ''}{_PROBE}</body>"))
    shown = browse(probed, *options, "--dump-dom")
    found = re.search(r'<pre id="probe">(.*?)</pre>', shown.stdout, re.DOTALL)
    assert found is not None, shown.stderr[-2000:]
    return json.loads(found[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")), console_lines(shown)


def after_script(page: Path, script: str, *options: str) -> tuple[Any, list[str]]:
    """What a script in the page returns, as JSON, and the console messages; it may await `pause(ms)`."""
    text = f"""<script>setTimeout(async () => {{
      const pause = (ms) => new Promise((done) => setTimeout(done, ms));
      const found = await (async () => {{ {script} }})();
      const place = document.body.appendChild(document.createElement("pre"));
      place.id = "probe";
      place.textContent = JSON.stringify(found);
    }}, 2500);</script>"""
    scripted = page.with_name(f"scripted_{page.name}")
    scripted.write_text(page.read_text().replace("</body>", f"{text}</body>"))
    shown = browse(scripted, *options, "--dump-dom")
    found = re.search(r'<pre id="probe">(.*?)</pre>', shown.stdout, re.DOTALL)
    assert found is not None, shown.stderr[-2000:]
    return json.loads(html.unescape(found[1])), console_lines(shown)


def take_picture(page: Path, picture: Path, *options: str) -> None:
    """Writes a picture of the window as a PNG file."""
    browse(page, "--hide-scrollbars", f"--screenshot={picture}", *options)


def print_page(page: Path, paper: Path) -> int:
    """Writes a PDF file of a page, and returns the number of its pages."""
    browse(page, f"--print-to-pdf={paper}", "--no-pdf-header-footer")
    content = paper.read_bytes()
    assert content.startswith(b"%PDF")
    return len(re.findall(rb"/Type\s*/Page\b", content))
