"""The command `rpojax export`: results or trajectories of a campaign in files that other tools read."""

from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Folder
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.errors import RpojaxError

FormatName = Literal["csv", "parquet", "mat", "npz"]


def export(
    directory: Folder,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write; several tables in CSV or Parquet get its name.")],
    form: Annotated[FormatName, arg(name="format", help="Format of the file.")],
    what: Annotated[
        str,
        arg(metavar="NAMES", help="Of metrics, draws, traces and history, with commas between them."),
    ] = "metrics,draws",
    run_id: Annotated[int | None, arg(metavar="I", help="This run alone.", help_behavior_hint="(default: all)")] = None,
    force: Annotated[bool, arg(help="Replace files that exist.")] = False,
    as_json: AsJson = False,
) -> int:
    """Write metrics, dispersed values, traces or histories as tables with units, for spreadsheets, pandas or MATLAB."""
    from rpojax.interop.tables.campaign_tables import TableName
    from rpojax.interop.tables.export import export as write

    names = [name.strip() for name in what.split(",") if name.strip()]
    for name in names:
        if name not in get_args(TableName):
            raise RpojaxError.of_argument("what", f"found {name!r}, expected some of {', '.join(get_args(TableName))}")
    paths = write(directory, out, form, names, run_id=run_id, force=force)  # type: ignore[arg-type]
    if as_json:
        print_json({"files": list(map(str, paths))})
    else:
        for path in paths:
            print(path)
    return Status.DONE
