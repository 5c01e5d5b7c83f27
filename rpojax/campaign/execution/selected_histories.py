"""Histories of runs that are selected by their results, such as failures.

A process that simulates blocks on its own devices stores the histories of the runs selected so far, and removes those
that its later runs displace. Runs that are selected among blocks of other processes are simulated again at the end.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.metrics.metric_catalogue import metrics_of_scenario, worst_first
from rpojax.scenario.plugins import plugin_registry

RequiredMetric = tuple[str, bool]
"""Metric of a requirement, and whether low values violate it."""


def pending_histories(campaign: Campaign) -> list[int]:
    """Numbers of the runs whose history is to be kept for their results and is not stored yet.

    All blocks of the campaign must be finished.
    """
    return sorted(_selected_run_ids(campaign) - set(campaign.history_ids))


def remove_displaced_histories(campaign: Campaign) -> None:
    """Removes histories that were kept for results which runs of later blocks surpass.

    All blocks of the campaign must be finished.
    """
    options = campaign.configuration.options
    if options.histories.depends_on_results:
        kept = _selected_run_ids(campaign) | options.histories.unconditional_run_ids(options.first_run, options.runs)
        for run_id in set(campaign.history_ids) - kept:
            campaign.remove_history(run_id)


def _selected_run_ids(campaign: Campaign) -> set[int]:
    retention = campaign.configuration.options.histories
    if not retention.depends_on_results:
        return set()
    required = _required_metrics(campaign)
    with metrics_of_scenario(plugin_registry.metrics_of(campaign.file)):
        return selected_by_result(retention, campaign.run_ids, campaign.failed, campaign.metrics, required)


def _required_metrics(campaign: Campaign) -> list[RequiredMetric]:
    """Metrics of requirements whose worst run keeps a history."""
    # Selected runs may have to be simulated again, and the images of a rendered camera would all be rendered again.
    wanted = [] if campaign.file.camera.model == "rendered" else campaign.file.requirements
    return [(requirement.metric_name, requirement.bound == "at least") for requirement in wanted]


class SelectionSoFar:
    """Runs whose histories are kept for their results, among those of the blocks stored so far.

    Attributes:
        run_ids: their numbers
    """

    def __init__(self, retention: Retention, required: Sequence[RequiredMetric]) -> None:
        """`required` are the metrics of the scenario's requirements, each with the side that violates it."""
        self._retention = retention
        self._required = required
        self._failed = np.zeros(0, dtype=bool)
        self._metrics: dict[str, np.ndarray] = {}
        self.run_ids = np.zeros(0, dtype=int)

    @classmethod
    def of_campaign(cls, campaign: Campaign) -> "SelectionSoFar | None":
        """Selection among the finished blocks of a campaign; None if no history is kept for results."""
        retention = campaign.configuration.options.histories
        if not retention.depends_on_results:
            return None
        selection = cls(retention, _required_metrics(campaign))
        if campaign.manifests:
            with metrics_of_scenario(plugin_registry.metrics_of(campaign.file)):
                selection.add(campaign.run_ids, campaign.failed, campaign.metrics)
        return selection

    def add(self, run_ids: np.ndarray, failed: np.ndarray, metrics: Mapping[str, np.ndarray]) -> set[int]:
        """Adds the runs of another block with `metrics`, name -> (runs,); returns the runs displaced."""
        before = set(self.run_ids.tolist())
        order = np.argsort(np.concatenate([self.run_ids, run_ids]), kind="stable")

        def joined(name: str) -> np.ndarray:
            return np.concatenate([self._metrics.get(name, np.zeros(0)), metrics[name]])[order]

        all_ids = np.concatenate([self.run_ids, run_ids])[order]
        all_failed = np.concatenate([self._failed, failed])[order]
        decisive = {metric for metric, _ in (*self._required, *self._retention.worst_kept)}
        all_metrics = {name: joined(name) for name in decisive}
        selected = selected_by_result(self._retention, all_ids, all_failed, all_metrics, self._required)
        kept = np.isin(all_ids, sorted(selected))
        self.run_ids, self._failed = all_ids[kept], all_failed[kept]
        self._metrics = {name: values[kept] for name, values in all_metrics.items()}
        return before - selected


def selected_by_result(
    retention: Retention,
    run_ids: np.ndarray,
    failed: np.ndarray,
    metrics: Mapping[str, np.ndarray],
    required: Sequence[RequiredMetric] = (),
) -> set[int]:
    """Numbers of the runs whose histories are kept because of their results.

    Args:
        retention: the rule
        run_ids: (runs,) run numbers
        failed: (runs,) whether the run failed
        metrics: name -> (runs,), nan if undefined
        required: metrics of the scenario's requirements, each with the side that violates it
    """
    kept: set[int] = set(run_ids[failed].tolist()) if retention.keeps_failures else set()
    for metric, count in retention.worst_kept:
        kept.update(run_ids[worst_first(metric, metrics[metric])[:count]].tolist())
    for metric, low_is_bad in required if retention.keeps_requirements else ():
        kept.update(run_ids[worst_first(metric, metrics[metric], low_is_bad)[:1]].tolist())
    return kept
