"""A campaign as an `xarray.Dataset` with named dimensions and units."""

from pathlib import Path
from typing import TYPE_CHECKING

from rpojax.campaign.storage.campaign_folder import Campaign

if TYPE_CHECKING:
    import xarray


def open_campaign(path: Path | str) -> "xarray.Dataset":
    """Finished runs of a campaign folder as an `xarray.Dataset`.

    Variables are metrics by their names, `trace.NAME` over `time` [s], `failed_at_s`, `failure_reason`, `outcome` and
    `completed`, dispersed values as `drawn.KEY` and `used.KEY`, and those of phases as `phase.NAME`, each with its unit
    as attribute `units`. Dimensions are `run`, with the run numbers as coordinate, `time`, and `axisI_N` for
    components. Attributes identify the campaign.

    Raises:
        RpojaxError: xarray is not installed, or the folder is no campaign that can be read.
    """
    return Campaign(path).to_xarray()
