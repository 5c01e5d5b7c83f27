"""Commands shown in the report can be run as they stand: quoted, from any folder, with what a plugin needs."""

import ast
import inspect
import shlex
from pathlib import Path
from typing import Any

import pytest
from report_page_parser import page_text, rendered_page, shown_commands
from synthetic_campaign_results import synthetic_campaign

import rpojax
from rpojax.campaign.rerun import rerun
from rpojax.campaign.run_and_resume import resume_campaign
from rpojax.cli import main
from rpojax.cli.command_parsing import parse
from rpojax.report import shell_commands
from rpojax.report.page.html_report import write_report

REQUIREMENTS = [
    {"metric": metric, "bound": bound, "limit": limit, "probability": probability, "consumer_risk": 0.1}
    for metric, bound, limit, probability in (
        ("formation_error_rms_m", "at most", 1e-3, 0.9),
        ("delta_v_m_s", "at most", 1e3, 0.99),
        ("min_range_m", "at least", 10.0, 0.99999),
    )
]


def called(command: str) -> dict[str, Any]:
    """Arguments of the call that a shell command makes; the permission to execute plugins is `allow_plugin`."""
    words = shlex.split(command)
    assert words[0] == "rpojax"
    allowed = "--allow-plugin" in words
    asked = parse(main.COMMANDS, [word for word in words[1:] if word != "--allow-plugin"], "")
    return {**vars(asked), "allow_plugin": allowed}


@pytest.mark.parametrize("plugin", [None, "/home/anna/my laws.py:setup"])
def test_every_command_of_a_page_is_understood_and_names_the_campaign(tmp_path: Path, plugin: str | None) -> None:
    campaign = synthetic_campaign(tmp_path / "Anna's runs (2)", runs=12, failed=(4,))
    campaign.info["scenario"] |= {"requirements": REQUIREMENTS} | ({} if plugin is None else {"plugin": plugin})
    commands = [*shown_commands(write_report(campaign)), shell_commands.more_runs_command(campaign, 300, 2)]
    verbs = {shlex.split(each)[1] for each in commands}
    assert {"rerun", "campaign", "probability"} <= verbs
    for command in [*commands, shell_commands.resume_command(campaign), shell_commands.film_command(campaign, 2)]:
        if " I " in command:  # a place for the number of a run
            command = command.replace(" I ", " 3 ")
        found = called(command)
        assert found["allow_plugin"] == (plugin is not None), command
        place = str(campaign.directory)
        named = [str(each) for each in found.values()]
        assert any(each in (place, f"{place}/scenario.toml") for each in named), command


def test_folders_are_absolute_wherever_the_report_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = synthetic_campaign(Path("out/one"), runs=12, failed=(4,))
    assert str(tmp_path / "out" / "one") in shlex.split(shell_commands.rerun_command(campaign, 4, "run_4"))
    assert str(tmp_path / "out" / "one" / "scenario.toml") in shlex.split(
        shell_commands.more_runs_command(campaign, 20, 1)
    )


def test_rerun_command_names_the_campaign_folder(build):
    campaign = build(runs=12, failed=(4,))
    command = f"rpojax rerun {campaign.directory} --run-id"
    words = page_text(rendered_page(campaign))
    assert f"Repeat a run {command} I --out DIR" in words
    assert f"{command} 4 --out run_4" in words


def test_replaced_stages_are_shown_and_needed_for_a_rerun(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["stages"] = {"formation_law": {"function": "mine.pd_law", "source_sha256": "ab" * 32}}
    words = page_text(rendered_page(campaign))
    assert f"Replaced stages formation_law = mine.pd_law, source {'ab' * 32}" in words
    assert "rpojax rerun " not in words
    found = f"rpojax.Campaign({str(campaign.directory)!r})"
    command = f"rpojax.campaign.rerun.rerun({found}, 4, pathlib.Path('run_4'), stages=...)"
    assert command in words
    bound_to(rerun, command)


def test_stages_of_a_plugin_file_are_repeated_from_the_shell(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["stages"] = {"formation_law": {"function": "laws.pd_law", "source_sha256": "ab" * 32}}
    campaign.info["scenario"] |= {"plugin": "/home/anna/laws.py:setup"}
    assert called(shell_commands.rerun_command(campaign, 4, "run_4"))["allow_plugin"]
    assert called(shell_commands.resume_command(campaign))["allow_plugin"]


def test_metrics_and_stages_from_python_are_repeated_from_python(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["stages"] = {"formation_law": {"function": "laws.pd_law", "source_sha256": "ab" * 32}}
    campaign.info["scenario"] |= {"plugin": "python", "requirements": REQUIREMENTS}
    resumed = bound_to(resume_campaign, shell_commands.resume_command(campaign))
    assert {"metrics", "stages"} <= set(resumed)
    assert "stages" in bound_to(rerun, shell_commands.rerun_command(campaign, 4, "run_4"))
    again = bound_to(rpojax.run_campaign, shell_commands.more_runs_command(campaign, 70, 1))
    assert {"metrics", "stages", "seed", "runs", "out"} <= set(again)
    assert shown_commands(write_report(campaign)) == [], "a shell has not the code"


def bound_to(function: Any, command: str) -> dict[str, Any]:
    """Arguments by name of a Python call, as the function takes them."""
    call = ast.parse(command, mode="eval").body
    assert isinstance(call, ast.Call)
    found = inspect.signature(function).bind(*call.args, **{str(word.arg): word.value for word in call.keywords})
    return dict(found.arguments)
