"""The page of one run: its timeline, path, camera, estimation errors, burns and wheels, without statistics."""

from collections.abc import Mapping
from typing import Any

from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.plotly_charts import Chart
from rpojax.report.figures.requirement_limits import limits_of_channels
from rpojax.report.page import page_templates
from rpojax.report.page.single_run import burns, run_outcome, run_timeline
from rpojax.report.page.single_run.relative_path import path_scene
from rpojax.report.page.single_run.run_charts import camera_charts, run_charts
from rpojax.report.page.template_values import RunDetail, run_detail_values
from rpojax.report.sections import identity_section


def is_single_run(content: Mapping[str, Any]) -> bool:
    """Whether the results are those of one run, as `rpojax run` and `rpojax rerun` leave them."""
    return content["runs"]["requested"] == 1


def render_run_page(campaign: CampaignResults, content: Mapping[str, Any], detail: RunDetail) -> str:
    """Page of the only run of a campaign; of a team with a part for each servicer."""
    run_id = detail.run_id
    histories = [] if run_id is None else [campaign.history(run_id, number) for number in range(_servicers(campaign))]
    charts: dict[str, Chart] = {}
    parts = [
        _servicer_part(campaign, content, int(run_id or 0), number, history, charts)
        for number, history in enumerate(histories)
    ]
    scene = path_scene(campaign, run_id, [])
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
        "outcome": run_outcome.run_sentence(campaign, content),
        "verdict_tiles": run_outcome.run_tiles(content),
        "parts": parts,
        "marks": run_timeline.time_marks(float(campaign.info.get("scenario", {}).get("duration_s", 1.0))),
        "has_scene": scene is not None,
        "drawn": run_outcome.drawn_rows(campaign),
        "safety": run_outcome.safety_rows(content["safety"]),
        "scenario": identity_section.scenario_lines(campaign),
        "limits": content["limits"],
        "identity": identity_section.identity_lines(campaign, content),
        **run_detail_values(campaign, content, detail),
    }
    return page_templates.render("run.html", {"charts": charts, "scene": scene}, values)


def _servicers(campaign: CampaignResults) -> int:
    return max(1, len(campaign.servicer_names))


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
        "events": run_outcome.event_rows([*phases, *run_timeline.events(campaign, run_id)]),
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
        "burns": burns.burn_rows(burns.find_burns(history)),
    }


def _image_px(campaign: CampaignResults) -> tuple[int, int] | None:
    """Width and height of the camera's image, None if the scenario does not state them."""
    camera = campaign.info.get("scenario", {}).get("camera", {})
    width, height = camera.get("width_px"), camera.get("height_px")
    return None if width is None or height is None else (int(width), int(height))
