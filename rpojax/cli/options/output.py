"""Options of the commands that turn results into reports and files, or exchange messages while a run goes on."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from rpojax.cli.options.arguments import (
    FLAT,
    AllowPlugin,
    AsJson,
    Command,
    Folder,
    NoCache,
    NoFilm,
    Overrides,
    Seed,
    Session,
    Source,
)
from rpojax.interop.cosimulation.live_settings import LiveSettings


@dataclass(frozen=True, kw_only=True)
class ReportCommand(Command):
    """Write report.html, report.json and figures again, or a brief report to print."""

    work = "output.report:report"

    directory: Folder
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show in detail.", help_behavior_hint="(default: the median one)")
    ] = None
    requirements: Annotated[
        Path | None,
        arg(metavar="FILE", help="Judge by the [[requirements]] of this TOML file from now on; the report says so."),
    ] = None
    reason: Annotated[str, arg(metavar="TEXT", help="Why requirements change.")] = ""
    brief: Annotated[bool, arg(help="Write brief.html instead: four A4 pages to print.")] = False
    no_film: NoFilm = False
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class ExportCommand(Command):
    """Write results as tables with units, or orbits and attitudes of one run as CCSDS messages or CZML."""

    work = "output.export:export"

    directory: Folder
    out: Annotated[Path, arg(metavar="FILE", help="File to write; several files get its name.")]
    form: Annotated[
        Literal["csv", "parquet", "mat", "npz", "oem", "aem", "opm", "czml"],
        arg(
            name="format",
            help="Tables: csv, parquet, mat, npz; of a run orbit, attitude, start, scene: oem, aem, opm, czml.",
        ),
    ]
    what: Annotated[
        str | None,
        arg(
            metavar="NAMES",
            help="Tables, with commas between them: runs (metrics and draws), metrics, draws, traces, history.",
            help_behavior_hint="(default: runs)",
        ),
    ] = None
    run_id: Annotated[int | None, arg(metavar="I", help="This run alone.", help_behavior_hint="(default: all)")] = None
    force: Annotated[bool, arg(help="Replace files that exist.")] = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class ExportBagCommand(Command):
    """Write one run of a campaign as a ROS 2 bag, without ROS, a namespace per servicer; the run is replayed."""

    work = "output.export_bag:export_bag"

    directory: Folder
    out: Annotated[Path, arg(metavar="BAG", help="Folder to make; its files have its name.")]
    run_id: Annotated[int, arg(metavar="I", help="Number of the run.")]
    form: Annotated[
        Literal["mcap", "sqlite3"], arg(name="format", help="Storage: mcap for Foxglove and Iron or later, or sqlite3.")
    ] = "mcap"
    images: Annotated[
        Literal["auto", "raw", "compressed", "none"],
        arg(help="Pictures of a rendered camera: raw, compressed (PNG) or none; auto: raw where there are any."),
    ] = "auto"
    force: Annotated[bool, arg(help="Replace the bag if there is one.")] = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class ExportRrdCommand(Command):
    """Write one run for the rerun viewer: both spacecraft, the camera and plots; the run is replayed."""

    work = "output.export_rrd:export_rrd"

    directory: Folder
    run_id: Annotated[int, arg(metavar="I", help="Run to show.")]
    out: Annotated[Path, arg(metavar="FILE", help="Recording to write (.rrd).")]
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a rendered camera to the next.")] = 1
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class BridgeCommand(Command):
    """Simulate one run live over DDS with ROS 2 messages; external nodes replace parts of the flight software.

    Exit status beside the usual: 3 the run failed, 4 it ended early because external nodes fell silent.
    """

    work = "output.bridge:bridge"

    scenario: Source
    settings: Annotated[LiveSettings, FLAT]
    session: Annotated[Session, FLAT]
    seed: Seed = 0
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0
    overrides: Overrides = ()
    no_pictures: Annotated[bool, arg(help="Send no pictures of a rendered camera.")] = False


@dataclass(frozen=True, kw_only=True)
class FilmCommand(Command):
    """Film of the rendered camera of a run with the detector's boxes; a run without a stored history is replayed.

    The cameras of a team stand side by side.
    """

    work = "output.film:film"

    directory: Folder
    out: Annotated[Path, arg(metavar="FILE", help="Film (.mp4) or sheet of twelve stills (.png).")]
    run_id: Annotated[
        int | None, arg(metavar="I", help="Run to show.", help_behavior_hint="(default: the first with a kept history)")
    ] = None
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a film to the next.")] = 10
    codec: Annotated[str, arg(metavar="KIND", help="Of a film: vp9, or h264 (extra viz).")] = "vp9"
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False
