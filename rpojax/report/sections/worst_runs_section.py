"""The runs that a reader will want to fly again: those with the worst values."""

from typing import Any

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.key_metrics import select_key_metrics
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.scenario.metric_catalogue import worst_first

_COUNT = 5


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: for each leading metric, or one of a requirement, the five worst runs, the worst first."""
    return [
        {"metric": name, "runs": [{"run_id": int(campaign.run_ids[row]), "value": float(values[row])} for row in rows]}
        for name in select_key_metrics(campaign)
        for values in [campaign.metrics[name]]
        for rows in [worst_first(name, values)[:_COUNT]]
    ]


def rows(entries: list[dict[str, Any]]) -> list[tuple[int, list[str]]]:
    """Run and what it is worst in, one line a run, those that are worst in most first."""
    found: dict[int, list[str]] = {}
    for entry in entries:
        shown = metric_label(entry["metric"])
        for place, run in enumerate(entry["runs"], start=1):
            value = with_unit(format_number(run["value"]), shown.unit)
            found.setdefault(run["run_id"], []).append(f"{shown.title} {value} ({_PLACES[place - 1]})")
    return sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))


_PLACES = ("worst", "2nd", "3rd", "4th", "5th")
