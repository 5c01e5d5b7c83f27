"""Worst runs: those with the worst values of the key metrics."""

from typing import Any

from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.key_metrics import select_key_metrics
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit

_PLACES = ("worst", "2nd", "3rd", "4th", "5th")


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: the five worst runs of each key metric, the worst first."""
    return [
        {"metric": name, "runs": [{"run_id": int(campaign.run_ids[row]), "value": float(values[row])} for row in rows]}
        for name in select_key_metrics(campaign)
        for values in [campaign.metrics[name]]
        for rows in [worst_first(name, values)[: len(_PLACES)]]
    ]


def rows(entries: list[dict[str, Any]]) -> list[tuple[int, list[str]]]:
    """Run number and the metrics in which it is among the worst; runs that are so in most metrics first."""
    found: dict[int, list[str]] = {}
    for entry in entries:
        label = metric_label(entry["metric"])
        for place, run in enumerate(entry["runs"], start=1):
            value = with_unit(format_number(run["value"]), label.unit)
            found.setdefault(run["run_id"], []).append(f"{label.title} {value} ({_PLACES[place - 1]})")
    return sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))
