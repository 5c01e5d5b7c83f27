"""Engine of a campaign that exists already, recreated from its `campaign.json` and checked against it."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpojax.batching import batching_mode
from rpojax.campaign import experiment_design
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.storage import provenance
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.provenance import package_versions
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.scenario_digest import scenario_digest

_REPRODUCIBILITY_PACKAGES = ("rpojax", "jax")
"""Packages whose versions change the last digits of a run."""


def recreate_engine(
    configuration: CampaignConfiguration, devices: Sequence[Any], stages: Stages | None = None
) -> BatchEngine:
    """Engine with the scenario, block size, batching, design and stages of a campaign's `campaign.json`.

    Raises:
        RpojaxError: the scenario, its trained files or the stages are not those of the campaign, or its batching is
            unknown.
    """
    file = scenario_loader.validate(configuration.scenario)
    if scenario_digest(file) != configuration.scenario_hash:
        raise RpojaxError(
            "scenario: found another content or trained files, expected those that the campaign began with"
        )
    provenance.check_same_stages(configuration.stages, plugin_registry.stages_of(file, stages))
    options = configuration.options
    design = experiment_design.recreate_design(file, options.seed, options.design_range, configuration.design_sha256)
    # Campaigns that do not record it began when there was no choice.
    recorded = batching_mode.DEFAULT_MODE if configuration.batching is None else configuration.batching
    batching = batching_mode.check_mode("batching", recorded)
    return BatchEngine(file, configuration.block_size, devices, stages, design, batching)


def check_versions(recorded: Mapping[str, str]) -> None:
    """Refuses package versions that differ from those of the campaign: the last digits of its runs may differ.

    Raises:
        RpojaxError: naming the package.
    """
    installed = package_versions()
    for name in _REPRODUCIBILITY_PACKAGES:
        if recorded.get(name) != installed[name]:
            raise RpojaxError(
                f"{name}: found version {installed[name]}, expected {recorded.get(name)}, with which the campaign began"
            )
