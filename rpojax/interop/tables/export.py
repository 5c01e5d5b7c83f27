"""Export of a campaign's results as tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rpojax.campaign.storage.atomic_outputs import check_replaceable
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, RpojaxError
from rpojax.interop.tables.campaign_tables import TABLE_NAMES, TableName, make_table
from rpojax.interop.tables.table_files import FILE_FORMATS, FileFormat, paths_of_tables, write_tables


def export(
    campaign: Campaign | Path | str,
    out: Path | str,
    form: FileFormat | None = None,
    what: Sequence[TableName] = ("metrics", "draws"),
    *,
    run_id: int | None = None,
    force: bool = False,
) -> list[Path]:
    """Writes results of a campaign for other tools, with the unit of every column; returns the paths of the files.

    Args:
        campaign: or its folder
        out: file; with several tables in CSV or Parquet, `NAME.csv` becomes `NAME_metrics.csv` and so on
        form: `csv`, `parquet`, `mat` or `npz`; by default that of the file's suffix
        what: of `metrics` and `draws`, one row a run, `traces`, one row for each run and sample, and `history`, one
            row for each run with a history and tick
        run_id: this run alone
        force: replace files that exist

    Raises:
        RpojaxError: the folder is no campaign, there is no such run, or it has no history.
        OutputError: a file exists already or cannot be written.
        MissingExtraError: Parquet needs a package that is not installed.
    """
    found = campaign if isinstance(campaign, Campaign) else Campaign(campaign)
    path = Path(out)
    chosen = form or path.suffix.removeprefix(".")
    if chosen not in FILE_FORMATS:
        raise RpojaxError.of_argument("form", f"found {chosen!r}, expected one of {', '.join(FILE_FORMATS)}")
    names = list(dict.fromkeys(what))
    for name in names:
        if name not in TABLE_NAMES:
            raise RpojaxError.of_argument("what", f"found {name!r}, expected some of {', '.join(TABLE_NAMES)}")
    if not names:
        raise RpojaxError.of_argument("what", f"found nothing, expected some of {', '.join(TABLE_NAMES)}")
    if path.is_dir():
        raise OutputError(f"{path}: found a folder, expected the name of a file")
    check_replaceable(paths_of_tables(path, names, chosen).values(), force)
    return write_tables([make_table(found, name, run_id) for name in names], path, chosen, _identity(found))


def _identity(campaign: Campaign) -> dict[str, Any]:
    """What identifies a campaign, in the types of JSON."""
    record = campaign.configuration.to_record()
    return {key: record[key] for key in ("name", "scenario_hash", "seed", "first_run", "runs", "id", "versions")}
