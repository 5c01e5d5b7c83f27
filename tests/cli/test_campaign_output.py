"""The sentence after an interrupt names commands that go on with the campaign at hand."""

import shlex
from pathlib import Path

from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing
from isolated_plugins import forgotten_plugins

from rpojax.cli.campaign_output import keeping_results
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry

PLUGIN = """import rpojax


def setup():
    return rpojax.Plugin(metrics={"minutes_late": lambda time_s: time_s[-1] / 60.0})
"""


def sentence(directory: Path) -> str:
    """What is said when work on a campaign is interrupted."""
    try:
        with keeping_results(directory):
            raise KeyboardInterrupt
    except KeyboardInterrupt as interrupt:
        return str(interrupt)


def commands(text: str) -> list[list[str]]:
    """Words of the commands in the sentence."""
    parts = [part.partition("rpojax ")[2] for part in text.split(", or ")]
    return [shlex.split(part) for part in parts]


def test_a_campaign_with_a_plugin_goes_on_with_its_permission(tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text(PLUGIN)
    (tmp_path / "own.toml").write_text('extends = "inspection"\nplugin = "laws.py:setup"\n')
    folder = tmp_path / "a b"
    with forgotten_plugins():
        plugin_registry.permit()
        campaign = empty_campaign(folder, scenario_loader.load(tmp_path / "own.toml"), 0, 4, 0, 2)
        campaign.write_block(0, synthetic_block(0), synthetic_timing())
        found = sentence(folder)
        assert found.startswith("1 of 2 blocks are kept")
        assert commands(found) == [["resume", str(folder), "--allow-plugin"]]
        campaign.write_block(1, synthetic_block(1), synthetic_timing())
        wanted = [["resume", str(folder), "--allow-plugin"], ["report", str(folder), "--allow-plugin"]]
        assert commands(sentence(folder)) == wanted


def test_a_campaign_without_one_needs_none(tmp_path: Path) -> None:
    folder = tmp_path / "a b"
    empty_campaign(folder, scenario_loader.load("inspection"), 0, 4, 0, 2)
    assert commands(sentence(folder)) == [["resume", str(folder)]]
