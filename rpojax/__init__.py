"""rpojax: differentiable, batched Monte Carlo simulation of vision-based rendezvous and proximity operations.

The names below load on first use, so that importing the package (or asking the command line for help) is instant.
"""

import importlib
from typing import TYPE_CHECKING, Any

from rpojax.version import __version__

if TYPE_CHECKING:
    from rpojax.campaign.dataset import open_campaign
    from rpojax.campaign.runner import resume_campaign, run_campaign
    from rpojax.campaign.single import simulate
    from rpojax.campaign.store import Campaign
    from rpojax.errors import RpojaxError
    from rpojax.flight.computer import Stages
    from rpojax.report.html import write_report
    from rpojax.simulation.scenario import load

_HOMES = {
    "Campaign": "rpojax.campaign.store",
    "RpojaxError": "rpojax.errors",
    "Stages": "rpojax.flight.computer",
    "load": "rpojax.simulation.scenario",
    "open_campaign": "rpojax.campaign.dataset",
    "resume_campaign": "rpojax.campaign.runner",
    "run_campaign": "rpojax.campaign.runner",
    "simulate": "rpojax.campaign.single",
    "write_report": "rpojax.report.html",
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
