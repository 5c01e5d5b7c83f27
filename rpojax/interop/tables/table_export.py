"""Export of a campaign's results as tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rpojax.campaign.storage.atomic_outputs import check_replaceable
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.interop.tables.campaign_tables import TABLE_NAMES, TableName, make_table
from rpojax.interop.tables.table_files import FileFormat, paths_of_tables, write_tables


def export_tables(
    campaign: Campaign, out: Path, form: FileFormat, what: Sequence[str], run_id: int | None, force: bool
) -> list[Path]:
    """Writes tables of a campaign, as `rpojax.export` does; returns the paths of the files.

    Raises:
        RpojaxError: there is no such run or table, or the run has no history.
        OutputError: a file exists already or cannot be written.
        MissingExtraError: Parquet needs a package that is not installed.
    """
    names: list[TableName] = [name for name in TABLE_NAMES if name in what]
    for name in what or [""]:
        if name not in TABLE_NAMES:
            raise RpojaxError.of_argument("what", f"found {name!r}, expected some of {', '.join(TABLE_NAMES)}")
    check_replaceable(paths_of_tables(out, names, form).values(), force)
    tables = [make_table(campaign, name, run_id) for name in names]
    return write_tables(tables, out, form, _identity(campaign))


def _identity(campaign: Campaign) -> dict[str, Any]:
    """What identifies a campaign, in the types of JSON."""
    record = campaign.configuration.to_record()
    return {key: record[key] for key in ("name", "scenario_hash", "seed", "first_run", "runs", "id", "versions")}
