"""Writes the report of a campaign: one self-contained HTML page, report.json and the figures of one run."""

from collections import OrderedDict
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically, write_json
from rpojax.campaign.storage.campaign_folder import of_servicer
from rpojax.errors import OutputError
from rpojax.metrics import metric_catalogue
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults, ChangedResults
from rpojax.report.figures.camera_pictures import CameraSheet, write_camera_sheet
from rpojax.report.figures.paper_figures import missing_channels, write_figures
from rpojax.report.left_out_parts import Notes
from rpojax.report.page import page_templates
from rpojax.report.page.detail_values import DetailValues, choose_run, detail_values
from rpojax.report.page.report_json import report_content
from rpojax.report.page.run_page import is_single_run, render_run_page
from rpojax.report.page.section_findings import section_findings
from rpojax.report.page.template_values import (
    PageFigures,
    RunDetail,
    figure_values,
    first_screen_values,
    page_charts,
    run_detail_values,
    table_values,
)
from rpojax.report.page.written_report import JSON_NAME, PAGE_NAME, with_digests
from rpojax.report.sections import coverage_section, identity_section, team_section
from rpojax.report.sections.dispersion_section import DrawnDistribution, drawn_distributions
from rpojax.runtime.progress import stage
from rpojax.scenario.plugins import plugin_registry

_READ_ONCE: Final = ("info", "run_ids", "metrics", "completed", "failed", "outcomes", "drawn", "traces", "trace_time_s")
_FURTHER_RUNS: Final = 16
"""Most runs with a history beside the median one and the worst ones that the page shows over time."""
KEPT_BYTES: Final = 400_000_000
"""Memory beyond which the history that was not used for longest is read again."""


class KeptResults(ChangedResults):
    """Results of a campaign, with a memory of what was read: every part of the report asks for them again.

    Args:
        campaign: results
        most_bytes: memory for histories; the latest is kept in any case
    """

    def __init__(self, campaign: CampaignResults, most_bytes: int = KEPT_BYTES) -> None:
        super().__init__(campaign)
        self._most_bytes = most_bytes
        self._kept: OrderedDict[int, Mapping[str, np.ndarray]] = OrderedDict()

    def history(self, run_id: int, servicer: int | None = None) -> Mapping[str, np.ndarray]:
        """Full history of a run, as the campaign has it."""
        if run_id not in self._kept:
            self._kept[run_id] = self._campaign.history(run_id)
            while len(self._kept) > 1 and sum(map(_bytes, self._kept.values())) > self._most_bytes:
                self._kept.popitem(last=False)
        self._kept.move_to_end(run_id)
        whole = self._kept[run_id]
        return whole if servicer is None or not self._campaign.servicer_names else of_servicer(whole, servicer)


def _remembered(name: str) -> property:
    def read(results: KeptResults) -> Any:
        if name not in results._changes:
            results._changes[name] = getattr(results._campaign, name)
        return results._changes[name]

    return property(read)


for _name in _READ_ONCE:
    setattr(KeptResults, _name, _remembered(_name))


def _bytes(history: Mapping[str, np.ndarray]) -> int:
    return sum(values.nbytes for values in history.values())


def write_report(
    campaign: CampaignResults, run_id: int | None = None, film: bool = True, *, progress: bool = True
) -> Path:
    """Writes report.html, report.json and the figures of one run into the campaign's folder; returns the page's path.

    Of a team the run is shown in detail as its first servicer had it.

    Args:
        campaign: results
        run_id: run shown beside the worst ones; by default the median one in formation error among those with a history
        film: whether to render the camera images of that run again, which takes some 20 s
        progress: show in a terminal that it is under way

    Raises:
        ResultError: no history of `run_id` is stored.
    """
    own = plugin_registry.recorded_metrics(campaign.info)
    with stage("writing the report", quiet=not progress, announce=False), metric_catalogue.metrics_of_scenario(own):
        kept: Any = KeptResults(campaign)
        return _write(kept, run_id, film)


def _write(campaign: CampaignResults, run_id: int | None, film: bool) -> Path:
    shown_run = choose_run(campaign, run_id)
    notes = Notes()
    drawn = notes.part("Dispersions", drawn_distributions, campaign)
    content = report_content(campaign, drawn, notes)
    _refuse_symlink(campaign.directory / "figures")
    no_detail = RunDetail(None, "", {}, {}, CameraSheet(None, "They could not be made."))
    detail = notes.derived("The run in detail", lambda: _run_detail(campaign, shown_run, film), no_detail)
    pictures = notes.derived(
        "Pictures",
        lambda: PageFigures(
            coverage_section.write_figure(campaign),
            team_section.write_figure(campaign, shown_run),
            coverage_section.dark_picture(campaign),
        ),
        PageFigures(None, None),
    )

    def rendered(results: CampaignResults) -> str:
        if is_single_run(content):
            return render_run_page(results, content, detail)
        return _render_page(results, content, drawn, detail, pictures, notes)

    page = notes.part("The page", rendered, campaign)
    content["limits"] = [
        *(sentence for sentence in notes.sentences if sentence not in content["limits"]),
        *content["limits"],
    ]
    written = page.encode("utf-8", "backslashreplace")
    seal = campaign.info.get("seal")
    write_json(campaign.directory / JSON_NAME, with_digests(content, campaign.directory, written, seal))
    return write_atomically(campaign.directory / PAGE_NAME, written)


def _run_detail(campaign: CampaignResults, shown_run: int | None, film: bool) -> RunDetail:
    """Figures and camera images of the run shown in detail, written into the folder."""
    servicer = campaign.servicer_names[0] if campaign.servicer_names else ""
    figures: dict[str, Path] = {}
    missing: dict[str, list[str]] = {}
    if shown_run is not None:
        title = f"{campaign.info.get('name', 'campaign')}, run {shown_run}"
        title += f", servicer {servicer}" if servicer else ""
        history = campaign.history(shown_run, 0)
        figures, missing = write_figures(history, campaign.directory / "figures", title), missing_channels(history)
    camera = write_camera_sheet(campaign, shown_run) if film else CameraSheet(None, "They were left out by --no-film.")
    return RunDetail(shown_run, servicer, figures, missing, camera)


def _refuse_symlink(folder: Path) -> None:
    """Raises OutputError if the folder for figures is a symbolic link."""
    if folder.is_symlink():
        raise OutputError(f"{folder}: found a link that leads elsewhere, expected a folder of the campaign")


def _render_page(
    campaign: CampaignResults,
    content: Mapping[str, Any],
    drawn: list[DrawnDistribution],
    detail: RunDetail,
    pictures: PageFigures,
    notes: Notes,
) -> str:
    charts = page_charts(campaign, content, notes)
    runs: DetailValues = notes.derived(
        "Runs in detail",
        lambda: detail_values(campaign, content, detail.run_id, _FURTHER_RUNS),
        detail_values(campaign, content, None),
    )
    data = {
        "charts": charts.charts,
        "explorer": charts.explorer,
        "detail": runs.detail,
        "scene": runs.scene,
        "runs": charts.runs,
    }
    values = {
        "name": campaign.info.get("name", "campaign"),
        "description": campaign.info.get("description", ""),
        "foot": page_templates.foot_text(campaign.info),
        "rerun_command": partial(shell_commands.rerun_command, campaign),
        "resume_command": shell_commands.resume_command(campaign),
        "runs": content["runs"],
        "warnings": content["warnings"],
        "independent": content["design"]["independent"],
        "scenario": identity_section.scenario_lines(campaign),
        "limits": list(dict.fromkeys([*notes.sentences, *content["limits"]])),
        "dispersions": drawn,
        **first_screen_values(campaign, content, charts),
        **charts.template_values,
        **table_values(campaign, content, notes),
        **run_detail_values(campaign, content, detail),
        **runs.template_values,
        **figure_values(pictures),
    }
    values["findings"] = section_findings(content, values)
    return page_templates.render("campaign.html", data, values)
