"""What a reader asks first of a campaign: how its runs ended, which requirements hold, and its key metrics."""

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from rpojax.analysis.statistics.tolerance_verdicts import Verdict
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.report.campaign_results import select_key_metrics
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.report.sections import requirement_verdict_section
from rpojax.scenario.plugins import plugin_registry
from rpojax.simulation.outcomes.outcome_kinds import count_outcomes
from rpojax.summary_text import Summary, counted

_SHOWN_METRICS: Final = 4
_SHOWN_REQUIREMENTS: Final = 4


def campaign_summary(campaign: Campaign) -> Summary:
    """Summary of the finished runs of a campaign; of a folder that cannot be read, what is wrong with it."""
    title = f"Campaign {campaign.configuration.name}"
    try:
        with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(campaign.info)):
            return Summary(f"{title}: {_progress(campaign)}", list(_rows(campaign)))
    except RpojaxError as error:
        return Summary(title, [("problem", str(error)), ("folder", str(campaign.directory))])


def _progress(campaign: Campaign) -> str:
    runs, done = campaign.configuration.runs, len(campaign.run_ids)
    shown = counted(done, "run") if done == runs else f"{done} of {runs} runs, unfinished"
    return f"{shown} of {campaign.file.duration_s:g} s, seed {campaign.info['seed']}"


def _rows(campaign: Campaign) -> Iterator[tuple[str, str]]:
    counts = {name: count for name, count in count_outcomes(campaign.outcomes).items() if count}
    yield "outcomes", ", ".join(f"{count} {name}" for name, count in counts.items()) or "no run is finished"
    yield from _requirements(campaign)
    for name in select_key_metrics(campaign)[:_SHOWN_METRICS]:
        yield "metrics", f"{name}: {_spread(campaign, name)}"
    if campaign.servicer_names:
        yield "servicers", ", ".join(campaign.servicer_names)
    if campaign.history_ids:
        yield "histories", f"of {len(campaign.history_ids)} runs, such as history({campaign.history_ids[0]})"
    yield "folder", str(campaign.directory)


def _requirements(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """Count of the requirements by verdict, and the first of those that are not verified, the most violated first."""
    missing = campaign.configuration.runs - len(campaign.run_ids)
    try:
        entries = requirement_verdict_section.content(campaign, missing)
    except ResultError as error:
        yield "requirements", str(error)
        return
    if entries:
        counts = Counter(entry["verdict"] for entry in entries)
        yield "requirements", ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    open_ones = [entry for entry in entries if entry["verdict"] != Verdict.VERIFIED]
    for entry in sorted(open_ones, key=lambda entry: -entry["violations"])[:_SHOWN_REQUIREMENTS]:
        kept = f"{entry['runs'] - entry['violations']} of {entry['runs']} runs keep it"
        worst = requirement_verdict_section.worst_text(entry)
        yield (
            "requirements",
            f"{entry['verdict_text']}: {entry['text']}; {kept}" + (f"; worst {worst}" if worst else ""),
        )
    if (more := len(open_ones) - _SHOWN_REQUIREMENTS) > 0:
        yield "requirements", f"and {counted(more, 'further one')}"


def _spread(campaign: Campaign, name: str) -> str:
    """Median, bad tail and worst value of a metric, with its unit."""
    values, label = campaign.metrics[name], metric_label(name)
    defined = values[np.isfinite(values)]
    tail, worst = (5.0, np.min) if label.low_is_bad else (95.0, np.max)
    found = f"median {format_number(float(np.median(defined)))}, p{tail:.0f} "
    found += f"{format_number(float(np.percentile(defined, tail)))}, worst {format_number(float(worst(defined)))}"
    lacking = int(np.sum(~np.isfinite(values) & np.asarray(campaign.failed, dtype=bool)))
    return with_unit(found, label.unit) + (f"; {counted(lacking, 'failed run')} without a value" if lacking else "")
