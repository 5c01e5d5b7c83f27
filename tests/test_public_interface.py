"""The public interface of the package: its names, their types, and that pages use no others."""

import ast
import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import rpojax

ROOT = Path(__file__).parents[1]
NAMES = {
    *("load", "ScenarioFile", "Scenario", "Params", "State", "Telemetry", "Stages", "RpojaxError"),
    *("nominal_parameters", "initialise_run", "run_key", "init", "step", "rollout", "simulate"),
    *("run_campaign", "resume_campaign", "open_campaign", "Campaign", "Retention", "Shard", "RunRange"),
    *("write_report", "prepare_process"),
    *("Plugin", "metric", "AdditionalSensor", "export"),
    *("gradient", "tune", "linear_covariance", "sensitivity", "worst_case", "robustness", "faults", "compare"),
    "estimate_probability",
}
SHOW_PROGRESS = (
    *("run_campaign", "resume_campaign"),
    *("gradient", "tune", "linear_covariance", "sensitivity", "worst_case", "robustness", "faults", "compare"),
    *("simulate", "write_report", "estimate_probability", "export"),
)
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])


def imported_modules(code: str) -> set[str]:
    """Modules of the package that Python code imports from, the package itself left out."""
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.startswith("rpojax.")}


def python_code(page: Path) -> str:
    """Python of a page: its fenced blocks, or the code cells of a notebook."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        return "\n".join("".join(cell["source"]) for cell in cells)
    return "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))


def test_the_public_names_are_these() -> None:
    assert {*rpojax.__all__} == NAMES | {"__version__"}
    assert {*dir(rpojax)} == {*rpojax.__all__}


@pytest.mark.parametrize("name", sorted(NAMES))
def test_a_public_name_has_a_docstring_and_types(name: str) -> None:
    found = getattr(rpojax, name)
    assert inspect.getdoc(found)
    if inspect.isfunction(found):
        parameters = inspect.signature(found).parameters.values()
        assert all(parameter.annotation is not parameter.empty for parameter in parameters)
        assert inspect.signature(found).return_annotation is not inspect.Signature.empty


@pytest.mark.parametrize("name", SHOW_PROGRESS)
def test_a_long_call_shows_progress_unless_told_not_to(name: str) -> None:
    assert inspect.signature(getattr(rpojax, name)).parameters["progress"].default is True


@pytest.mark.parametrize(("set_before", "found"), [(None, "3"), ("0", "0")])
def test_the_alarm_of_the_compiler_stays_off_the_terminal_of_a_program(set_before: str | None, found: str) -> None:
    code = "import os, rpojax; rpojax.run_campaign; print(os.environ['TF_CPP_MIN_LOG_LEVEL'])"
    environment = {name: value for name, value in os.environ.items() if name != "TF_CPP_MIN_LOG_LEVEL"}
    environment |= {} if set_before is None else {"TF_CPP_MIN_LOG_LEVEL": set_before}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == found


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = rpojax.no_such_name


def test_the_package_is_marked_as_typed_and_the_marker_is_shipped() -> None:
    assert (ROOT / "rpojax" / "py.typed").is_file()
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    assert build["targets"]["wheel"]["packages"] == ["rpojax"]


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda page: page.name)
def test_examples_use_public_names_alone(page: Path) -> None:
    code = python_code(page)
    assert imported_modules(code) == set()
    assert {name for name in re.findall(r"\brpojax\.(\w+)", code) if name not in rpojax.__all__} == set()
