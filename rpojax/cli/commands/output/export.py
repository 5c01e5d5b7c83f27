"""The command `rpojax export`: results or trajectories of a campaign in files that other tools read."""

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Folder, NoCache
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.runtime.progress import run_progress

FormatName = Literal["csv", "parquet", "mat", "npz", "oem", "aem", "opm", "czml"]


def export(
    directory: Folder,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write; several files get its name.")],
    form: Annotated[
        FormatName,
        arg(
            name="format",
            help="Tables: csv, parquet, mat, npz; of a run orbit, attitude, start, scene: oem, aem, opm, czml.",
        ),
    ],
    what: Annotated[
        str, arg(metavar="NAMES", help="Tables, with commas between them: metrics, draws, traces, history.")
    ] = "metrics,draws",
    run_id: Annotated[int | None, arg(metavar="I", help="This run alone.", help_behavior_hint="(default: all)")] = None,
    force: Annotated[bool, arg(help="Replace files that exist.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Write results as tables with units, or orbits and attitudes of one run as CCSDS messages or CZML."""
    prepare_jax(cache=not no_cache)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.interop import export as exports

    found = Campaign(directory)
    names = [name.strip() for name in what.split(",") if name.strip()]
    options = exports.ExportOptions(tables=tuple(names), run_id=run_id, force=force)
    with run_progress(found.file.duration_s, quiet=as_json) as watch:
        paths = exports.export_as(found, out, form, options, watch)
    if as_json:
        print_json({"files": list(map(str, paths))})
    else:
        for path in paths:
            print(path)
    return Status.DONE
