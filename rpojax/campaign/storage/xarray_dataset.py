"""A campaign as an `xarray.Dataset` with named dimensions and units."""

from pathlib import Path
from typing import TYPE_CHECKING

from rpojax.campaign.storage.campaign_folder import Campaign

if TYPE_CHECKING:
    import xarray


def open_campaign(path: Path | str) -> "xarray.Dataset":
    """Finished runs of a campaign folder as an `xarray.Dataset`.

    Variables are metrics, `failed_at_s`, `failure_reason`, `outcome` and `completed`, traces such as `range_m` over
    `time` [s], and dispersed values by their keys, such as `servicer.mass_kg`, each with its unit as attribute `units`.
    A trace with the name of a metric is `NAME_over_time`; what each phase has is `NAME_by_phase`, what each servicer of
    a team has `NAME_by_servicer`, and a value read back from the runs `used.KEY`. Dimensions with coordinates are
    `run`, `time`, `phase`, `servicer`, `axis` (x, y, z) and `quaternion`; `transition` counts, and `axisI_N` are other
    components. Attributes identify the campaign.

    Raises:
        RpojaxError: xarray is not installed, or the folder is no campaign that can be read.
    """
    return Campaign(path).to_xarray()
