"""rpojax: differentiable, batched Monte Carlo simulation of vision-based rendezvous and proximity operations.

The names below load on first use, so that importing the package (or asking the command line for help) is instant.
"""

import importlib
from typing import TYPE_CHECKING, Any

from rpojax.version import __version__

if TYPE_CHECKING:
    from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
    from rpojax.campaign.single_run import simulate
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.campaign.storage.xarray_dataset import open_campaign
    from rpojax.errors import RpojaxError
    from rpojax.flight.computer import Stages
    from rpojax.report.page.html_report import write_report
    from rpojax.scenario.loading.scenario_loader import load

_HOMES = {
    "Campaign": "rpojax.campaign.storage.campaign_folder",
    "RpojaxError": "rpojax.errors",
    "Stages": "rpojax.flight.computer",
    "load": "rpojax.scenario.loading.scenario_loader",
    "open_campaign": "rpojax.campaign.storage.xarray_dataset",
    "resume_campaign": "rpojax.campaign.run_and_resume",
    "run_campaign": "rpojax.campaign.run_and_resume",
    "simulate": "rpojax.campaign.single_run",
    "write_report": "rpojax.report.page.html_report",
}

__all__ = [
    "Campaign",
    "RpojaxError",
    "Stages",
    "__version__",
    "load",
    "open_campaign",
    "resume_campaign",
    "run_campaign",
    "simulate",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'rpojax' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
