"""The page of one run: its timeline, path, camera, estimation errors, burns and wheels, without statistics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.plotly_charts import Chart
from rpojax.report.figures.requirement_limits import limits_of_channels
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.report.page import page_templates, run_playback, run_timeline
from rpojax.report.page.first_screen import VerdictTile, passive_safety_count
from rpojax.report.page.run_charts import camera_charts, run_charts
from rpojax.report.page.run_series import formation_error
from rpojax.report.page.template_values import RunDetail, run_detail_values
from rpojax.report.sections import cause_section, identity_section
from rpojax.report.sections.requirement_verdict_section import limit_text
from rpojax.report.sections.safety_section import worst_value_texts

_LEAST_M_S: Final = 1e-7
"""Smaller changes in a tick are rounding of the channel."""
_LONGEST_GAP: Final = 2
"""Ticks without thrust that do not end a burn."""
_NOT_JUDGED: Final = "The run is not judged: it ends before limits.arrive_by_s, from which on it must be on station"


@dataclass(frozen=True)
class Burn:
    """A burn: when it began and ended [s], velocity change [m/s], and range and formation error [m] at its begin."""

    begin_s: float
    end_s: float
    delta_v_m_s: float
    range_m: float
    formation_error_m: float


def find_burns(history: Mapping[str, np.ndarray]) -> list[Burn]:
    """Burns in order of time; none if the history lacks the velocity change or the position."""
    if not {"delta_v_m_s", "rho_H", "rho_desired_H"} <= history.keys():
        return []
    spent = np.nan_to_num(np.asarray(history["delta_v_m_s"], dtype=np.float64), nan=0.0)
    ticks = np.flatnonzero(np.diff(spent) > _LEAST_M_S)
    if not len(ticks):
        return []
    parts = np.split(ticks, np.flatnonzero(np.diff(ticks) > _LONGEST_GAP + 1) + 1)
    error, time = formation_error(history), history["time_s"]
    distance = np.linalg.norm(history["rho_H"], axis=-1)
    return [
        Burn(
            float(time[part[0]]),
            float(time[part[-1] + 1]),
            float(spent[part[-1] + 1] - spent[part[0]]),
            float(distance[part[0]]),
            float(error[part[0]]),
        )
        for part in parts
    ]


def burn_rows(burns: Sequence[Burn]) -> list[tuple[float, list[str]]]:
    """Begin [s], and cells: number, begin, duration, velocity change in mm/s, range and formation error then."""
    return [
        (
            burn.begin_s,
            [
                str(number),
                format_number(burn.begin_s),
                format_number(burn.end_s - burn.begin_s),
                format_number(1e3 * burn.delta_v_m_s, 3),
                format_number(burn.range_m, 3),
                format_number(burn.formation_error_m, 3),
            ],
        )
        for number, burn in enumerate(burns, start=1)
    ]


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
    rows = [("Smallest range", worst_value_texts(safety["least_range"], "m")[0], False)]
    if sphere is not None:
        entered = safety["entries"]["count"] > 0
        rows.append((f"Entered the keep-out sphere{of_sphere}", "yes" if entered else "no", entered))
    for words, drift in drifts:
        rows.append((f"Smallest range in {words}", worst_value_texts(drift["least_range"], "m")[0], False))
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
        rows.append((title, worst_value_texts(safety[key], "s")[0], False))
    return [row for row in rows if row[1]]


def drawn_rows(campaign: CampaignResults) -> list[tuple[str, str]]:
    """Key and value drawn for the run of every dispersed quantity."""
    rows = []
    for key, values in campaign.drawn.items():
        if len(values):
            numbers = np.atleast_1d(np.asarray(values[0], dtype=np.float64)).ravel()
            rows.append((key, ", ".join(format_number(float(number)) for number in numbers)))
    return rows


def event_rows(events: Sequence[tuple[float, str]]) -> list[tuple[float, str, str]]:
    """Time [s] as a number and as text, and what happened."""
    return [(at_s, format_number(at_s), text) for at_s, text in sorted(events)]


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


def is_single_run(content: Mapping[str, Any]) -> bool:
    """Whether the campaign has a single run, as `rpojax run` and `rpojax rerun` make it."""
    return content["runs"]["requested"] == 1


def render_run_page(campaign: CampaignResults, content: Mapping[str, Any], detail: RunDetail) -> str:
    """Page of the only run of a campaign; of a team with a part for each servicer."""
    run_id = detail.run_id
    servicers = range(max(1, len(campaign.servicer_names)))
    histories = [] if run_id is None else [campaign.history(run_id, number) for number in servicers]
    charts: dict[str, Chart] = {}
    parts = [
        _servicer_part(campaign, content, int(run_id or 0), number, history, charts)
        for number, history in enumerate(histories)
    ]
    played = run_playback.playback(campaign, run_id)
    rerun_of = campaign.info.get("rerun_of")
    values = {
        "name": campaign.info.get("name", "campaign"),
        "description": campaign.info.get("description", ""),
        "foot": page_templates.foot_text(campaign.info),
        "run": run_id if run_id is not None else next(iter(campaign.run_ids.tolist()), "?"),
        "repeats": "" if not rerun_of else f"repeated from a campaign of {rerun_of['runs']} runs",
        "resume_command": shell_commands.resume_command(campaign),
        "missing": content["runs"]["missing"],
        "warnings": content["warnings"],
        "outcome": run_sentence(campaign, content),
        "why": cause_section.sentence_of_run(content["why_failed"]),
        "verdict_tiles": run_tiles(content),
        "parts": parts,
        "marks": run_timeline.time_marks(float(campaign.info.get("scenario", {}).get("duration_s", 1.0))),
        **_playback_values(campaign, played),
        "drawn": drawn_rows(campaign),
        "safety": safety_rows(content["safety"]),
        "scenario": identity_section.scenario_lines(campaign),
        "limits": content["limits"],
        "identity": identity_section.identity_lines(campaign, content),
        **run_detail_values(campaign, content, detail),
    }
    return page_templates.render("run.html", {"charts": charts, "playback": played}, values)


def _playback_values(campaign: CampaignResults, played: Mapping[str, Any] | None) -> dict[str, Any]:
    """Whether there is a playback, whose cameras it shows, and how much longer the run was meant to be."""
    if played is None:
        return {"has_playback": False}
    servicers = played["servicers"]
    corridors = [zone["corridor"] for each in servicers for zone in each["zones"] or []]
    return {
        "has_playback": True,
        "has_landmarks": any("landmarks_px" in each["arrays"] for each in servicers),
        "has_estimated_axes": any("q_HT_estimate" in each["arrays"] for each in servicers),
        "has_turning_corridor": "q_HT" in played["scene"] and any(each and each["turns"] for each in corridors),
        "has_camera": all(each["camera"] is not None for each in servicers),
        "servicer_names": campaign.servicer_names,
        "strip_stretch": played["duration_s"] / max(played["end_s"], played["tick_s"]),
    }


def _servicer_part(
    campaign: CampaignResults,
    content: Mapping[str, Any],
    run_id: int,
    number: int,
    history: Mapping[str, Any],
    charts: dict[str, Chart],
) -> dict[str, Any]:
    """Timeline, events, burns and names of the charts of one servicer; its charts are added to `charts`."""
    found = run_charts(history, limits_of_channels(content["requirements"]))
    boxes = camera_charts(history, _image_px(campaign))
    duration = float(campaign.info.get("scenario", {}).get("duration_s", history["time_s"][-1]))
    prefix = f"{number}-"
    charts.update({prefix + name: chart for name, (_, chart) in (found | boxes).items()})
    errors = [(prefix + name, title) for name, (title, _) in found.items() if name.startswith("error-")]
    phases = run_timeline.phase_events(history, campaign.phase_names)
    return {
        "name": campaign.servicer_names[number] if campaign.servicer_names else "",
        "timeline": run_timeline.timeline(campaign, run_id, history, duration),
        "events": event_rows([*phases, *run_timeline.events(campaign, run_id)]),
        "state": [(prefix + name, found[name][0]) for name in ("range_m", "formation_error_m") if name in found],
        "estimation": [
            *((prefix + name, found[name][0]) for name in ("nav_relative_error_m", "nees_relative") if name in found),
            *errors,
        ],
        "actuators": [
            (prefix + name, found[name][0])
            for name in ("delta_v_m_s", "wheel_speed_fraction", "pointing_error_deg")
            if name in found
        ],
        "camera": [(prefix + name, title) for name, (title, _) in boxes.items()],
        "burns": burn_rows(find_burns(history)),
    }


def _image_px(campaign: CampaignResults) -> tuple[int, int] | None:
    """Width and height of the camera's image, None if the scenario does not state them."""
    camera = campaign.info.get("scenario", {}).get("camera", {})
    width, height = camera.get("width_px"), camera.get("height_px")
    return None if width is None or height is None else (int(width), int(height))
