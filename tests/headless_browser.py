"""Chromium without a window: document and console of a page, measures of its layout, pictures and PDF."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next((found for name in _NAMES if (found := shutil.which(name))), None)
_QUIET = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
_PROBE = """<script>setTimeout(() => {
  const shown = (one) => one.getClientRects().length > 0;
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
    width: document.documentElement.clientWidth, content: document.documentElement.scrollWidth, tables,
    sheets: [...document.querySelectorAll(".sheet")].map((sheet) => {
      const foot = sheet.querySelector(".sheet-foot").getBoundingClientRect().top;
      const parts = [...sheet.children].filter((one) => !one.classList.contains("sheet-foot"));
      return foot - Math.max(...parts.map((one) => one.getBoundingClientRect().bottom));
    }),
    main: [...document.querySelectorAll("main")].map((one) => one.getBoundingClientRect().width),
    undrawn: [...document.querySelectorAll(".chart")].filter((one) => one.dataset.drawn !== "yes").length,
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


def measure(page: Path, *options: str) -> tuple[dict[str, Any], list[str]]:
    """Measures of the layout of a page, and its console messages."""
    probed = page.with_name(f"probed_{page.name}")
    probed.write_text(page.read_text().replace("</body>", f"{_PROBE}</body>"))
    shown = browse(probed, *options, "--dump-dom")
    found = re.search(r'<pre id="probe">(.*?)</pre>', shown.stdout, re.DOTALL)
    assert found is not None, shown.stderr[-2000:]
    return json.loads(found[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")), console_lines(shown)


def take_picture(page: Path, picture: Path, *options: str) -> None:
    """Writes a picture of the window as a PNG file."""
    browse(page, "--hide-scrollbars", f"--screenshot={picture}", *options)


def print_page(page: Path, paper: Path) -> int:
    """Writes a PDF file of a page, and returns the number of its pages."""
    browse(page, f"--print-to-pdf={paper}", "--no-pdf-header-footer")
    content = paper.read_bytes()
    assert content.startswith(b"%PDF")
    return len(re.findall(rb"/Type\s*/Page\b", content))
