"""The page on what changed from one campaign to others of the same runs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rpojax.analysis.statistics.campaign_comparison import CampaignComparison, defined_differently, without
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import ResultError
from rpojax.metrics import metric_catalogue
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.plotly_charts import Chart
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import in_display_order, metric_label, of_all_servicers
from rpojax.report.page import page_templates
from rpojax.report.page.comparison import comparison_charts, comparison_tables
from rpojax.scenario.plugins import plugin_registry

MAX_CAMPAIGNS: Final = len(comparison_charts.COLOURS)
_LETTERS: Final = "ABCDEF"


def write_comparison(
    campaigns: Sequence[CampaignResults], comparisons: Sequence[CampaignComparison], path: Path
) -> Path:
    """Writes the page on campaigns, each but the first compared with the first; returns its path.

    Raises:
        ResultError: the campaigns are more than there are colours for.
    """
    check_count(len(campaigns))
    own = {}
    for campaign in reversed(campaigns):
        own |= plugin_registry.recorded_metrics(campaign.info)
    with metric_catalogue.metrics_of_scenario(own):
        return _write(campaigns, comparisons, path)


def _write(campaigns: Sequence[CampaignResults], comparisons: Sequence[CampaignComparison], path: Path) -> Path:
    names = [f"{letter}: {each.directory.name}" for letter, each in zip(_LETTERS, campaigns, strict=False)]
    charts, values = _charts(campaigns, names)
    values |= {
        "title_text": " / ".join(names),
        "foot": page_templates.foot_text(campaigns[0].info) + f" \N{MIDDLE DOT} compared with {len(campaigns) - 1}",
        "names": names,
        "folders": [_identity(campaign) for campaign in campaigns],
        "requirements": comparison_tables.requirement_table(campaigns),
        "parts": [_part(found, names[0], names[number]) for number, found in enumerate(comparisons, start=1)],
    }
    page = page_templates.render("comparison.html", {"charts": charts}, values)
    return write_atomically(path, page.encode("utf-8", "backslashreplace"))


def check_count(campaigns: int) -> None:
    """Refuses more campaigns than the page has colours for.

    Raises:
        ResultError: naming how many it takes.
    """
    if campaigns > MAX_CAMPAIGNS:
        raise ResultError(f"compare: found {campaigns} folders, expected at most {MAX_CAMPAIGNS}")


def _part(found: CampaignComparison, first: str, second: str) -> dict[str, Any]:
    """Tables of one campaign compared with the first."""
    return {
        "first": first,
        "second": second,
        "sentence": comparison_tables.comparison_sentence(found),
        "warnings": found.warnings,
        "changed": [(each.key, _short(each.first), _short(each.second)) for each in found.changed],
        "rows": comparison_tables.change_rows(found),
        "events": comparison_tables.event_rows(found),
        "independent": found.independent,
    }


def _charts(campaigns: Sequence[CampaignResults], names: Sequence[str]) -> tuple[dict[str, Chart], dict[str, Any]]:
    limits = _limits(campaigns)
    differing = [name for each in campaigns[1:] for name in defined_differently(campaigns[0].info, each.info)]
    alike = without(campaigns[0].metrics, differing)
    together = [name for name in alike if all(name in each.metrics for each in campaigns)]
    charts: dict[str, Chart] = {}
    histograms = []
    for name in sorted(of_all_servicers(in_display_order(together)), key=lambda name: name not in limits):
        chart = comparison_charts.histogram_overlay(name, campaigns, names, limits.get(name, []))
        if chart is not None:
            charts[f"histogram-{name}"] = chart
            histograms.append((name, metric_label(name)))
    envelopes = comparison_charts.envelope_overlays(campaigns, names)
    charts |= {f"envelope-{name}": chart for name, (_, chart) in envelopes.items()}
    return charts, {"histograms": histograms, "envelopes": [channel for channel, _ in envelopes.values()]}


def _limits(campaigns: Sequence[CampaignResults]) -> dict[str, list[Limit]]:
    """Limits of the requirements of all campaigns by metric, each once; those in a window are left out."""
    found: dict[str, list[Limit]] = {}
    for campaign in campaigns:
        for entry in campaign.info.get("scenario", {}).get("requirements") or []:
            if any(entry.get(key) is not None for key in ("phase", "at", "from_s", "to_s")):
                continue
            limit = Limit(entry["metric"], float(entry["limit"]), entry["bound"] == "at most")
            if limit not in found.setdefault(limit.metric, []):
                found[limit.metric].append(limit)
    return found


def _identity(campaign: CampaignResults) -> list[tuple[str, str]]:
    info: Mapping[str, Any] = campaign.info
    failed = int(campaign.failed.sum())
    return [
        ("Folder", str(campaign.directory)),
        ("Scenario", f"{info.get('name', '')}, hash {info.get('scenario_hash', '')}"),
        ("Runs", f"{len(campaign.completed)}, {failed} failed; seed {info.get('seed', '')}"),
        ("Created", f"{info.get('created', '')}, rpojax {info.get('versions', {}).get('rpojax', '')}"),
    ]


def _short(value: Any) -> str:
    text = "\N{EN DASH}" if value is None else repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
