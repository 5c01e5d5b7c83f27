"""What the site takes from the code is all that the code has."""

import ast
import json
import re
import sys
from pathlib import Path

import pytest

import rpojax
from rpojax.cli import main
from rpojax.metrics import metric_catalogue
from rpojax.scenario.schema import ScenarioFile

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

from site_extensions import command_help, key_table, public_names, report_shape, written_reference  # noqa: E402


def test_the_python_interface_has_every_public_name_once() -> None:
    listed = [name for names in public_names.GROUPS.values() for name in names]
    assert sorted(listed) == sorted({*rpojax.__all__} - {"__version__"})


def test_every_command_has_its_help() -> None:
    helps = dict(command_help.helps())
    commands = {*main.COMMANDS}
    assert {words.split()[0] for words in helps} == commands
    assert all(text.startswith("usage: rpojax") and "--help" in text for text in helps.values())


def test_the_help_of_every_command_with_a_scenario_or_a_campaign_names_the_plugin() -> None:
    helps = dict(command_help.helps())
    takes = {
        words for words, text in helps.items() if re.search(r"\b(SCENARIO|DIR|DIR_A)\b", text.partition("\n\n")[0])
    }
    assert {"run", "campaign", "compare", "film", "bench", "calibrate-camera-model"} <= takes
    without = {"field evaluate", "field train", "field render", "detector data", "detector train", "detect", "new"}
    assert {words for words in takes - without if "--allow-plugin" not in helps[words]} == set()


@pytest.mark.parametrize("group", ["field", "detector"])
def test_the_commands_of_a_group_are_those_that_it_lists(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main.main([group, "--help"])
    printed = capsys.readouterr().out
    for words in dict(command_help.helps()):
        first, _, second = words.partition(" ")
        if first == group:
            assert second in printed


def test_the_table_of_keys_has_every_key_with_a_meaning() -> None:
    text = "\n".join(key_table.lines())
    rows = {line.split("|")[1].strip(" `"): line.split("|") for line in text.splitlines() if line.startswith("| `")}
    schema = ScenarioFile.model_json_schema()
    for name in ("navigation", "camera", "limits", "target"):
        keys = schema["$defs"][f"{name.capitalize()}Section"]["properties"]
        assert {f"{name}.{key}" for key in keys} <= {*rows}
    assert [key for key, cells in rows.items() if not cells[5].strip()] == []
    assert rows["faults.NAME.start_s"][6].strip().startswith("effects.faults = true; a kind other than 'none'")
    assert rows["gps.noise_m"][6].strip() == ""
    assert "4.0" in rows["navigation.gate_sigma"][3]
    assert rows["navigation.gate_sigma"][4].strip() == "yes"
    assert rows["effects.drag"][4].strip() == ""
    assert rows["thruster.rise_time_s"][5].strip() == "from the opening of the valve to full force"
    assert rows["phases.NAME.until.time_s"][5].strip() == "time since the phase began"
    assert rows["limits.lost_after_s"][2].strip() == "number > 0, default 600.0"


@pytest.mark.parametrize("name", written_reference.PARTS)
def test_a_committed_page_has_what_the_code_says(name: str) -> None:
    assert written_reference.is_current(name), "run: python docs/write_reference.py"


def test_every_public_name_has_its_signature_or_fields_on_the_page() -> None:
    text = "\n".join(public_names.lines())
    assert text.count("\n### `rpojax.") == len(rpojax.__all__) - 1
    assert "- `Campaign.plot`: Figures of the finished runs" in text
    assert "- `units`" not in text
    assert "    progress: bool = True," in text
    assert "rpojax.open_campaign(path: Path | str) -> xarray.Dataset" in text


def test_every_module_of_metrics_has_a_heading_of_its_own() -> None:
    names = [metric.name for module in metric_catalogue.MODULES for metric in module.METRICS]
    assert sorted(names) == sorted(metric_catalogue.METRICS)


def test_the_shape_merges_reports_and_names_what_varies() -> None:
    first = {"runs": {"failed": 0}, "metrics": {"a": {"mean": 1.0}}, "failures": []}
    second = {"runs": {"failed": 1}, "metrics": {"b": {"mean": None}}, "failures": [{"run_id": 3}]}
    assert report_shape.shape(first, second) == {
        "runs.failed": "whole number",
        "metrics.METRIC.mean": "null or number",
        "failures": "empty list",
        "failures[].run_id": "whole number",
    }
    assert report_shape.purpose("runs").startswith("`requested`")


def test_the_committed_shape_has_every_part_that_the_report_writes() -> None:
    shape = json.loads(report_shape.FILE.read_text(encoding="utf-8"))
    parts = {key.partition(".")[0].partition("[")[0] for key in shape}
    source = (ROOT / "rpojax" / "report" / "page" / "report_json.py").read_text(encoding="utf-8")
    functions = {node.name: node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}
    written = {
        key.value
        for name in ("summarise", "report_content")
        for record in (each for each in ast.walk(functions[name]) if isinstance(each, ast.Dict))
        for key in record.keys
        if isinstance(key, ast.Constant) and key.col_offset == 8
    }
    assert written
    assert written <= parts
