"""rpojax: differentiable, batched Monte Carlo simulation of vision-based rendezvous and proximity operations.

The public interface is the names below. They load on first use, so that importing the package, or asking the command
line for help, is instant.
"""

import importlib
from typing import TYPE_CHECKING, Any

from rpojax.version import __version__

if TYPE_CHECKING:
    from rpojax.analysis.gradients.derivative_sensitivity import sensitivity
    from rpojax.analysis.gradients.scenario_gradient import gradient
    from rpojax.analysis.gradients.tuning.tune import tune
    from rpojax.analysis.linear_covariance.linear_covariance import linear_covariance
    from rpojax.analysis.reliability.rare_events.estimate_probability import estimate_probability
    from rpojax.analysis.reliability.worst_case import worst_case
    from rpojax.analysis.statistics.campaign_comparison import compare
    from rpojax.campaign.options.campaign_options import Shard
    from rpojax.campaign.options.history_retention import Retention
    from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
    from rpojax.campaign.single_run import initialise_run, nominal_parameters, simulate
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.campaign.storage.xarray_dataset import open_campaign
    from rpojax.dispersions.designs.run_range import RunRange
    from rpojax.errors import RpojaxError
    from rpojax.flight.stages import Stages
    from rpojax.interop.export import export
    from rpojax.report.page.html_report import write_report
    from rpojax.runtime.jax_environment import prepare_process
    from rpojax.scenario.loading.scenario_loader import load
    from rpojax.scenario.params import Params
    from rpojax.scenario.plugins.custom_metrics import metric
    from rpojax.scenario.plugins.plugin import Plugin
    from rpojax.scenario.schema import ScenarioFile
    from rpojax.scenario.static_settings import Scenario
    from rpojax.sensors.additional.additional_sensor import AdditionalSensor
    from rpojax.simulation.initial_state import init
    from rpojax.simulation.noise import run_key
    from rpojax.simulation.rollout import rollout
    from rpojax.simulation.state import State
    from rpojax.simulation.step import step
    from rpojax.simulation.telemetry import Telemetry

_MODULE_OF = {
    "AdditionalSensor": "sensors.additional.additional_sensor",
    "Campaign": "campaign.storage.campaign_folder",
    "Params": "scenario.params",
    "Plugin": "scenario.plugins.plugin",
    "Retention": "campaign.options.history_retention",
    "RpojaxError": "errors",
    "RunRange": "dispersions.designs.run_range",
    "Scenario": "scenario.static_settings",
    "ScenarioFile": "scenario.schema",
    "Shard": "campaign.options.campaign_options",
    "Stages": "flight.stages",
    "State": "simulation.state",
    "Telemetry": "simulation.telemetry",
    "compare": "analysis.statistics.campaign_comparison",
    "estimate_probability": "analysis.reliability.rare_events.estimate_probability",
    "export": "interop.export",
    "gradient": "analysis.gradients.scenario_gradient",
    "init": "simulation.initial_state",
    "initialise_run": "campaign.single_run",
    "linear_covariance": "analysis.linear_covariance.linear_covariance",
    "load": "scenario.loading.scenario_loader",
    "metric": "scenario.plugins.custom_metrics",
    "nominal_parameters": "campaign.single_run",
    "open_campaign": "campaign.storage.xarray_dataset",
    "prepare_process": "runtime.jax_environment",
    "resume_campaign": "campaign.run_and_resume",
    "rollout": "simulation.rollout",
    "run_campaign": "campaign.run_and_resume",
    "run_key": "simulation.noise",
    "sensitivity": "analysis.gradients.derivative_sensitivity",
    "simulate": "campaign.single_run",
    "step": "simulation.step",
    "tune": "analysis.gradients.tuning.tune",
    "worst_case": "analysis.reliability.worst_case",
    "write_report": "report.page.html_report",
}
"""Public name -> its module in the package."""

__all__ = [
    "AdditionalSensor",
    "Campaign",
    "Params",
    "Plugin",
    "Retention",
    "RpojaxError",
    "RunRange",
    "Scenario",
    "ScenarioFile",
    "Shard",
    "Stages",
    "State",
    "Telemetry",
    "__version__",
    "compare",
    "estimate_probability",
    "export",
    "gradient",
    "init",
    "initialise_run",
    "linear_covariance",
    "load",
    "metric",
    "nominal_parameters",
    "open_campaign",
    "prepare_process",
    "resume_campaign",
    "rollout",
    "run_campaign",
    "run_key",
    "sensitivity",
    "simulate",
    "step",
    "tune",
    "worst_case",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'rpojax' has no attribute {name!r}")
    jax_environment = importlib.import_module("rpojax.runtime.jax_environment")
    jax_environment.hide_compiler_log()
    return getattr(importlib.import_module(f"rpojax.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
