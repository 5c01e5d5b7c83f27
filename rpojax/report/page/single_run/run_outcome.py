"""Outcome of one run: a sentence, and its value against the limit of every requirement, without statistics."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number, with_unit
from rpojax.report.page.outcome.verdict_tiles import VerdictTile, passive_safety_count
from rpojax.report.sections.requirement_verdict_section import limit_text

_NOT_JUDGED: Final = "The run is not judged: it ends before limits.arrive_by_s, from which on it must be on station"


def run_sentence(campaign: CampaignResults, content: Mapping[str, Any]) -> str:
    """How the run ended, how many requirements it met, and what it did to passive safety."""
    runs = content["runs"]
    if runs["missing"] == runs["requested"]:
        return "The run has not ended yet."
    failure = content["failures"][0] if content["failures"] else None
    ended = _NOT_JUDGED if runs["not_judged"] else "The run completed"
    if failure is not None:
        detail = f" ({failure['detail']})" if failure["detail"] else ""
        ended = f"The run failed: {failure['reason']}{detail}, since {format_number(failure['at_s'])} s"
    counted = [entry for entry in content["requirements"] if entry["runs"]]
    met = sum(entry["violations"] == 0 for entry in counted)
    parts = [ended]
    if counted:
        parts.append(f"{met} of {len(counted)} limits of requirements kept")
    found = passive_safety_count(content["safety"])
    if found is not None:
        horizon, proportion = found
        could = "could" if proportion["count"] else "could not"
        parts.append(f"after a loss of thrust it {could} drift into the keep-out sphere within {horizon}")
    return "; ".join(parts) + "."


def run_tiles(content: Mapping[str, Any]) -> list[VerdictTile]:
    """A tile for each requirement with the value of the run, those beyond their limit first, and passive safety."""
    tiles = [_tile(entry) for entry in content["requirements"]]
    found = passive_safety_count(content["safety"])
    if found is not None:
        horizon, proportion = found
        value = "fails" if proportion["count"] else "holds"
        note = f"free drift within {horizon} from any instant"
        tiles.insert(
            0, VerdictTile("Passive safety", value, note, "alert" if proportion["count"] else "good", "safety")
        )
    return sorted(tiles, key=lambda tile: ("alert", "open", "good").index(tile.css_class))


def safety_rows(safety: Mapping[str, Any]) -> list[tuple[str, str, bool]]:
    """Quantity, value of the run, and whether it is bad, of the closest approach and of free drifts."""
    sphere = safety["keep_out_m"]
    of_sphere = "" if not isinstance(sphere, float) else f" of {with_unit(format_number(sphere), 'm')}"
    drifts = [(f"free drift within {drift['horizon'].replace('_', ' ')}", drift) for drift in safety["free_drift"]]
    drifts.append(("24 h after a burn that did not end", safety["stuck_on"]))
    rows = [("Smallest range", _range_text(safety["least_range"]), False)]
    if sphere is not None:
        entered = safety["entries"]["count"] > 0
        rows.append((f"Entered the keep-out sphere{of_sphere}", "yes" if entered else "no", entered))
    for words, drift in drifts:
        rows.append((f"Smallest range in {words}", _range_text(drift["least_range"]), False))
        if (below := drift["below_keep_out"]) is not None and below["runs"]:
            could = below["count"] > 0
            rows.append((f"Could enter the keep-out sphere in {words}", "yes" if could else "no", could))
    share = safety["unsafe_share"]["worst"]
    if share is not None:
        text = f"{100.0 * share['value']:.3g} %"
        rows.append(("Share of the time from which the longest drift enters the sphere", text, share["value"] > 0.0))
    for title, key in (
        ("Longest look-away in a burn period", "longest_look_away"),
        ("Longest time unseen", "longest_unseen"),
    ):
        found = safety[key]
        rows.append((title, "" if found is None else with_unit(format_number(found["value"]), "s"), False))
    return [row for row in rows if row[1]]


def _range_text(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return ""
    return ("at most " if found.get("at_most") else "") + with_unit(format_number(found["value"]), "m")


def drawn_rows(campaign: CampaignResults) -> list[tuple[str, str]]:
    """Key and value drawn for the run of every dispersed quantity."""
    rows = []
    for key, values in campaign.drawn.items():
        if len(values):
            numbers = np.atleast_1d(np.asarray(values[0], dtype=np.float64)).ravel()
            rows.append((key, ", ".join(format_number(float(number)) for number in numbers)))
    return rows


def event_rows(events: Sequence[tuple[float, str]]) -> list[tuple[str, str]]:
    """Time in seconds as text, and what happened."""
    return [(format_number(at_s), text) for at_s, text in sorted(events)]


def _tile(entry: Mapping[str, Any]) -> VerdictTile:
    name = entry.get("of", entry["metric"])
    label = metric_label(name)
    title = limit_text(entry)
    if not entry["runs"]:
        return VerdictTile(title, "does not count", "the run ended otherwise or never was there", "open", "metrics")
    if entry.get("reached") == 0:
        return VerdictTile(title, "not reached", "the run never was there, which violates it", "alert", "metrics")
    if entry["worst"] is None:
        return VerdictTile(title, "no value", "the run ended before it had one", "alert", "metrics")
    sign = 1.0 if entry["bound"] == "at most" else -1.0
    margin = sign * (entry["limit"] - entry["worst"])
    value = with_unit(format_number(entry["worst"], 3), label.unit)
    note = f"margin {with_unit(format_number(margin, 3).replace('-', chr(0x2212)), label.unit)}"
    return VerdictTile(title, value, note, "good" if margin >= 0.0 else "alert", "metrics")
