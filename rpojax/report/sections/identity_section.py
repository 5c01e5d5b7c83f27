"""Identity of a campaign: scenario, seed, versions, device and timing."""

import json
from collections.abc import Mapping
from typing import Any

from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults, design_phrase, runs_are_independent
from rpojax.report.labels import format_number
from rpojax.report.sections.failure_section import outcomes_text

_MAX_LINE_LENGTH = 4000


def identity_lines(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of each property that identifies a campaign."""
    info, runs = campaign.info, summary["runs"]
    versions = ", ".join(f"{name} {version}" for name, version in info.get("versions", {}).items())
    counts = f"{runs['requested']} requested, {runs['completed']} completed, {runs['failed']} failed"
    kinds = f" ({outcomes_text(runs['outcomes'])})" if runs["failed"] else ""
    kinds += f", {runs['not_judged']} not judged" if runs["not_judged"] else ""
    missing = f", {runs['missing']} missing" if runs["missing"] else ""
    lines = [
        ("Scenario hash", info.get("scenario_hash")),
        ("Seal", "unsealed" if not info.get("sealed", True) else info.get("seal")),
        ("Master seed", info.get("seed")),
        ("Runs", f"{counts}{kinds}{missing}"),
        ("Replaced stages", _replaced_stages_text(info.get("stages") or {})),
        ("Versions", versions),
        ("Device", " ".join(str(info[key]) for key in ("device", "dtype") if key in info)),
        ("Block size", info.get("block_size")),
        ("Created", info.get("created")),
        ("Timing", _timing_text(info.get("timing") or {})),
        ("Design", "" if runs_are_independent(campaign) else f"{design_phrase(campaign)}: runs are not independent"),
        ("Repeat a run", shell_commands.rerun_command(campaign, "I", "DIR")),
    ]
    return [(label, str(text)) for label, text in lines if text not in (None, "")]


def scenario_lines(campaign: CampaignResults) -> list[str]:
    """Resolved scenario as `section.key = value` lines, as `--set` takes them; long lines are truncated."""
    lines = _key_value_lines(campaign.info.get("scenario", {}), "")
    return [line if len(line) <= _MAX_LINE_LENGTH else f"{line[:_MAX_LINE_LENGTH]} ..." for line in lines]


def _replaced_stages_text(stages: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{name} = {stage['function']}, source {stage['source_sha256'] or 'unknown'}" for name, stage in stages.items()
    )


def _timing_text(timing: Mapping[str, Any]) -> str:
    parts = [
        ("compile_s", "{} s compiling"),
        ("run_s", "{} s running"),
        ("run_seconds_per_s", "{} simulated seconds per second"),
        ("devices", "{} device(s)"),
    ]
    return ", ".join(text.format(format_number(float(timing[key]), 3)) for key, text in parts if key in timing)


def _key_value_lines(value: Any, path: str) -> list[str]:
    if isinstance(value, Mapping) and value:
        return [
            line
            for key, item in value.items()
            for line in _key_value_lines(item, f"{path}.{key}" if path else str(key))
        ]
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        return [f"{path}[{index}] = {json.dumps(item, default=str)}" for index, item in enumerate(value)]
    return [f"{path} = {json.dumps(value, default=str)}"] if path else []
