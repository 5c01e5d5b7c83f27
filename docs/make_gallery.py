"""Makes what the gallery of the site shows, from the product itself:

python docs/make_gallery.py pictures    all packaged scenarios, in docs/images/gallery, and the report's first screen
python docs/make_gallery.py files       a report, a brief report as PDF, a film and a run in 3-D, in docs/made

Pictures are committed; files are made when the site is built. Both take commands of `rpojax`, and Chromium for pages.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from headless_browser import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    BROWSER,
    print_page,
    take_picture,
    view_options,
)

from rpojax import Campaign  # noqa: E402
from rpojax.report.figures.colours import BLUE, GREEN, GRID, INK, MUTED, ORANGE, PURPLE, SKY_BLUE, VERMILLION  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

PICTURES = ROOT / "docs" / "images" / "gallery"
REPORT_PICTURE = ROOT / "docs" / "images" / "report.png"
RECORDING_PICTURE = ROOT / "docs" / "images" / "run_3d.png"
VIEWER_PORTS = 9190, 9976
RUNS = 6
COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY_BLUE)
REPORT_RUNS, FILM_S = 64, 600


def main() -> None:
    """Makes the pictures or the files, as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("pictures", "files"))
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "made", help="folder of the files")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "gallery", help="folder of the campaigns")
    parser.add_argument("--only", nargs="*", help="names of scenarios to draw; all by default")
    arguments = parser.parse_args()
    if BROWSER is None:
        raise SystemExit("found no Chromium, expected one on the path: it prints the brief report and takes pictures")
    arguments.work.mkdir(parents=True, exist_ok=True)
    if arguments.what == "files":
        make_files(arguments.out, arguments.work)
    else:
        make_pictures(arguments.work, arguments.only)


def make_files(out: Path, work: Path) -> None:
    """Writes report.html, brief.html, brief.pdf, film.mp4 and run.rrd into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    first, pixels = work / "first", work / "pixels"
    _campaign("inspection", first, REPORT_RUNS)
    _rpojax("report", first, "--brief")
    for name in ("report.html", "brief.html"):
        (out / name).write_bytes((first / name).read_bytes())
    print_page(first / "brief.html", out / "brief.pdf")
    _rendered_run(pixels)
    _rpojax("film", pixels, "--out", out / "film.mp4", "--codec", "h264", "--force")
    _record(pixels, out / "run.rrd")


def make_pictures(work: Path, only: list[str] | None) -> None:
    """Draws the paths of a few runs of every packaged scenario, and takes the picture of the report's first screen."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in only or scenario_loader.packaged_names():
        folder = work / name
        _campaign(name, folder, RUNS, "--histories", "all", "--no-report")
        draw_paths(Campaign(folder), PICTURES / f"{name}.png")
    if only is None:
        _campaign("inspection", work / "first", REPORT_RUNS)
        take_picture(work / "first" / "report.html", REPORT_PICTURE, *view_options(1440, 1060))
        _reduce(REPORT_PICTURE, colours=96)
        _rendered_run(work / "pixels")
        _record(work / "pixels", work / "run.rrd")
        draw_recording(work / "run.rrd", RECORDING_PICTURE)


def draw_paths(campaign: Campaign, file: Path) -> None:
    """Paths of the servicers in the target's Hill frame: in the orbit plane, and seen from above."""
    figure = Figure(figsize=(6.4, 3.0), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2)
    servicers = [str(name) for name in campaign.servicer_names] or [None]
    for run in sorted(campaign.history_ids):
        for index, servicer in enumerate(servicers):
            rho = campaign.history(run, *((index,) if servicer else ()))["rho_H"]
            colour = COLOURS[index if servicer else run % len(COLOURS)]
            for axes, component in zip(panels, (0, 2), strict=True):
                axes.plot(rho[:, 1], rho[:, component], color=colour, lw=0.8, alpha=0.8)
                axes.plot(*rho[0, [1, component]], ".", color=colour, ms=3.0)
    keep_out = campaign.file.limits.keep_out_m
    for axes, label in zip(panels, ("radial [m]", "orbit normal [m]"), strict=True):
        _finish(axes, label, keep_out)
    lost = int(np.sum(~campaign.completed))
    text = f"{campaign.file.name}: {RUNS} runs" + (f", {lost} not completed" if lost else "")
    figure.suptitle(text, fontsize=10, color=INK)
    figure.savefig(file, dpi=100)
    _reduce(file, colours=48)


def draw_recording(recording: Path, file: Path) -> None:
    """Picture of a recording in rerun's viewer, which a browser without a window shows by software rendering."""
    web, data = VIEWER_PORTS
    ports = ("--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(web), "--port", str(data))
    command = [str(Path(sys.executable).with_name("rerun")), str(recording), *ports]
    server = subprocess.Popen(command, start_new_session=True)  # it starts a process of its own, which must end too
    source = quote(f"rerun+http://127.0.0.1:{data}/proxy", safe="")
    rendering = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
    try:
        time.sleep(5.0)
        with tempfile.TemporaryDirectory() as profile:
            options = ("--headless=new", "--no-sandbox", "--no-first-run", "--hide-scrollbars", *rendering)
            place = (f"--user-data-dir={profile}", "--window-size=1400,900", f"--screenshot={file}")
            address = f"http://127.0.0.1:{web}/?url={source}"
            for patience_s in (60, 120, 240, 480):  # on a busy machine the viewer is slow to start
                budget = f"--virtual-time-budget={1000 * patience_s}"
                subprocess.run([str(BROWSER), *options, *place, budget, address], check=True, capture_output=True)
                if _colours(file) > _VIEWER_COLOURS:
                    break
            else:
                raise SystemExit("the viewer did not show the recording")
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.wait()
    _reduce(file, colours=96)


_VIEWER_COLOURS = 1000
"""A started viewer shows more colours, the screen before it a few dozen."""


def _colours(file: Path) -> int:
    with Image.open(file) as picture:
        return len(picture.convert("RGB").getcolors(picture.width * picture.height) or ())


def _rendered_run(folder: Path) -> None:
    if not folder.exists():
        changed = ("--set", "camera.model=rendered", "--set", f"duration_s={FILM_S}")
        _rpojax("run", "inspection", *changed, "--out", folder)


def _record(folder: Path, file: Path) -> None:
    _rpojax("export-rrd", folder, "--run-id", 0, "--every", 10, "--out", file, "--force")


def _finish(axes: Axes, label: str, keep_out: float) -> None:
    axes.add_patch(Circle((0.0, 0.0), keep_out, fill=False, ls="--", lw=0.8, color=MUTED))
    axes.plot(0.0, 0.0, "s", color=INK, ms=4.0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("along-track [m]", fontsize=8, color=MUTED)
    axes.set_ylabel(label, fontsize=8, color=MUTED)
    axes.grid(color=GRID, lw=0.6)
    axes.tick_params(labelsize=7, colors=MUTED, length=2)
    axes.spines[:].set_color(GRID)


def _reduce(file: Path, colours: int) -> None:
    """Fewer colours in a PNG file, so that it stays small."""
    with Image.open(file) as picture:
        reduced = picture.convert("RGB").quantize(colours)
    reduced.save(file, optimize=True)


def _campaign(name: str, folder: Path, runs: int, *options: object) -> None:
    if not folder.exists():
        _rpojax("campaign", name, "--runs", runs, "--seed", 0, "--out", folder, *options)


def _rpojax(*words: object) -> None:
    # A report names the folder of its campaign, which is to be no path of this machine.
    within = [w.relative_to(ROOT) if isinstance(w, Path) and w.is_relative_to(ROOT) else w for w in words]
    done = subprocess.run([sys.executable, "-m", "rpojax", *map(str, within)], cwd=ROOT, check=False)
    if done.returncode not in (0, 3):  # 3: some runs of the campaign failed, which a picture may show
        raise SystemExit(done.returncode)


if __name__ == "__main__":
    main()
