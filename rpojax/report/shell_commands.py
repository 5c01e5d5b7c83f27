"""Commands shown in the report, ready to be copied: for a shell, or for Python where it alone has the code.

Folders are absolute, since a page is read from anywhere.
"""

from pathlib import Path

from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.plugins.command_lines import command_line, needs_permission
from rpojax.scenario.plugins.plugin_registry import FROM_PYTHON


def rerun_command(campaign: CampaignResults, run: int | str, out: str) -> str:
    """Command that repeats one run with full history; a Python call if the code of the campaign came from Python."""
    if code := _code_from_python(campaign):
        folder = f"rpojax.Campaign({str(_folder(campaign))!r})"
        given = ", stages=..." if "stages" in code else ""
        call = f"rpojax.campaign.rerun.rerun({folder}, {run}, pathlib.Path({out!r}){given})"
        return f"{call}  # after rpojax.load with the same plugin" if "metrics" in code else call
    return command_line("rerun", _folder(campaign), "--run-id", run, "--out", out, plugin=plugin_of(campaign))


def resume_command(campaign: CampaignResults) -> str:
    """Command that simulates the missing runs of a campaign and rewrites its report."""
    if code := _code_from_python(campaign):
        given = "".join(f", {name}=..." for name in code)
        return f"rpojax.resume_campaign({str(_folder(campaign))!r}{given})"
    return command_line("resume", _folder(campaign), plugin=plugin_of(campaign))


def more_runs_command(campaign: CampaignResults, runs: int, seed: int) -> str:
    """Command that simulates the scenario of a campaign anew, with other runs."""
    scenario = scenario_copy(campaign)
    if code := _code_from_python(campaign):
        given = "".join(f", {name}=..." for name in code)
        file = "file" if "metrics" in code else f"rpojax.load({str(scenario)!r})"
        given += ", until_decided=True" if campaign.info.get("sequential") else ""
        return f"rpojax.run_campaign({file}, runs={runs}, seed={seed}, out='DIR'{given})"
    number = ("--until-decided", "--at-most", runs) if campaign.info.get("sequential") else ("--runs", runs)
    return command_line("campaign", scenario, *number, "--seed", seed, "--out", "DIR", plugin=plugin_of(campaign))


def film_command(campaign: CampaignResults, run: int | None) -> str:
    """Command that makes a film of the camera images of a run."""
    return command_line("film", _folder(campaign), "--run-id", run, "--out", "film.mp4", plugin=plugin_of(campaign))


def scenario_copy(campaign: CampaignResults) -> Path:
    """Path of the campaign's scenario, which has all that was set by `--set`."""
    return _folder(campaign) / "scenario.toml"


def plugin_of(campaign: CampaignResults) -> str | None:
    """Reference of the plugin of a campaign's scenario, None without one."""
    found = campaign.info.get("scenario", {}).get("plugin")
    return found if isinstance(found, str) else None


def _folder(campaign: CampaignResults) -> Path:
    return campaign.directory.absolute()


def _code_from_python(campaign: CampaignResults) -> tuple[str, ...]:
    """Arguments of Python calls with code that no file names: `metrics` of a plugin, `stages` of the flight software.

    Stages of a campaign with a plugin file are those of the plugin.
    """
    plugin = plugin_of(campaign)
    metrics = ("metrics",) if plugin == FROM_PYTHON else ()
    return (*metrics, "stages") if campaign.info.get("stages") and not needs_permission(plugin) else metrics
