"""Export of a campaign: results as tables; orbits and attitudes of one run as messages of the CCSDS or as CZML."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np

from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_atomically
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, RpojaxError
from rpojax.interop import ccsds_messages, czml_document, run_replay, spacecraft_states
from rpojax.interop.campaign_tables import FILE_FORMATS, TableName, export_tables
from rpojax.interop.ccsds_messages import MESSAGE_KINDS
from rpojax.interop.run_replay import ReplayedRun
from rpojax.interop.spacecraft_states import BothStates
from rpojax.runtime.progress import ProgressCallback, run_progress, stage

ExportFormat = Literal["csv", "parquet", "mat", "npz", "oem", "aem", "opm", "czml"]
FORMATS: Final[tuple[ExportFormat, ...]] = get_args(ExportFormat)
SIMULATED: Final = ("oem", "aem", "czml")
"""Formats for which a run is simulated again."""
DEFAULT_TABLES: Final[tuple[TableName, ...]] = ("runs",)
"""Table that is written where none is named."""


@dataclass(frozen=True)
class ExportOptions:
    """What is exported, and whether files are replaced.

    Attributes:
        tables: names of tables, None for `runs`; only formats of tables have a choice
        run_id: this run alone, None for all
        force: replace files that exist
    """

    tables: tuple[str, ...] | None = None
    run_id: int | None = None
    force: bool = False


def export(
    campaign: Campaign | Path | str,
    out: Path | str,
    form: ExportFormat | None = None,
    what: Sequence[TableName] | None = None,
    *,
    run_id: int | None = None,
    force: bool = False,
    progress: bool = True,
) -> list[Path]:
    """Writes results of a campaign for other tools; returns the paths of the files.

    Tables (`csv`, `parquet`, `mat`, `npz`) have the unit of every column. Messages of the CCSDS (`oem`, `aem`, `opm`)
    have orbit, attitude or start of every spacecraft of a run, which is simulated again in double precision, and the
    target's attitude as it is estimated from landmarks; CZML (`czml`) shows that run on the globe of CesiumJS.

    Args:
        campaign: or its folder
        out: file; with several of them, `NAME.csv` becomes `NAME_metrics.csv` and `NAME.oem` `NAME_servicer.oem`
        form: format, by default that of the file's suffix
        what: tables: `runs` (the default), one row a run with metrics and draws, these alone as `metrics` and `draws`,
            `traces`, one row for each run and sample, and `history`, one row for each run with a history and tick;
            refused with formats without tables
        run_id: this run alone; needed for messages and CZML
        force: replace files that exist
        progress: show progress on stderr

    Raises:
        RpojaxError: the folder is no campaign, there is no such run, or it has no history.
        OutputError: a file exists already or cannot be written.
        MissingExtraError: Parquet or CZML needs a package that is not installed.
    """
    found = campaign if isinstance(campaign, Campaign) else Campaign(campaign)
    options = ExportOptions(None if what is None else tuple(what), run_id, force)
    name = form or Path(out).suffix.removeprefix(".")
    if name not in SIMULATED:
        with stage(f"writing {name}", quiet=not progress):
            return export_as(found, Path(out), name, options)
    with run_progress(found.file.duration_s, quiet=not progress) as shown:
        return export_as(found, Path(out), name, options, shown)


def export_as(
    campaign: Campaign, out: Path, form: str, options: ExportOptions, on_progress: ProgressCallback | None = None
) -> list[Path]:
    """Writes results of a campaign in a format, as `export` does; returns the paths of the files.

    Raises:
        RpojaxError: there is no such format, table or run, or the run has no history.
        OutputError: a file exists already or cannot be written.
    """
    if out.is_dir():
        raise OutputError(f"{out}: found a folder, expected the name of a file")
    if form in FILE_FORMATS:
        tables = DEFAULT_TABLES if options.tables is None else options.tables
        return export_tables(campaign, out, form, tables, options.run_id, options.force)
    if form != "czml" and form not in MESSAGE_KINDS:
        raise RpojaxError.of_argument("form", f"found {form!r}, expected one of {', '.join(FORMATS)}")
    if options.tables is not None:
        expected = f"nothing for {form.upper()}; {', '.join(FILE_FORMATS)} have tables"
        raise RpojaxError.of_argument("what", f"found {', '.join(options.tables)!r}, expected {expected}")
    if options.run_id is None:
        raise RpojaxError.of_argument("run_id", f"found none, expected the run whose {form.upper()} is wanted")
    if form == "czml":
        check_replaceable([out], options.force)
        runs = _replay(campaign, options.run_id, on_progress)
        text = czml_document.czml(spacecraft_states.replayed_states(runs, campaign), czml_document.shapes_of(runs))
        return [write_atomically(out, text.encode())]
    names = spacecraft_states.spacecraft_names(campaign.file)
    names += spacecraft_states.estimate_names(campaign.file) if form == "aem" else ()
    ccsds_messages.check_messages(out, names, options.force)
    if form == "opm":
        return ccsds_messages.write_messages(spacecraft_states.initial_states(campaign, options.run_id), form, out)
    runs = _replay(campaign, options.run_id, on_progress)
    states = spacecraft_states.replayed_states(runs, campaign)
    if form == "aem":
        # Without a known attitude there is nothing to write.
        estimates = spacecraft_states.estimated_attitudes(runs, campaign)
        states += [each for each in estimates if np.isfinite(each.q).all(axis=1).any()]
    return ccsds_messages.write_messages(states, form, out)


def _replay(
    campaign: Campaign, run_id: int, on_progress: ProgressCallback | None
) -> tuple[ReplayedRun[BothStates], ...]:
    return run_replay.replay_servicers(campaign, run_id, spacecraft_states.observe_tick, on_progress=on_progress)
