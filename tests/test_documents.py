"""README, pages and scripts agree with the code and with each other."""

import ast
import inspect
import json
import os
import re
import subprocess
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args

import jax
import jax.numpy as jnp
import pytest
from element_sets import TLE
from markdown_blocks import code_blocks

import rpojax
from rpojax.analysis.statistics.tolerance_bounds import runs_for_bound
from rpojax.campaign.single_run import initialise_run
from rpojax.core.random_streams import Stream
from rpojax.dispersions.designs.design_sections import Design
from rpojax.dispersions.kinds.registry import Dispersion
from rpojax.errors import RpojaxError
from rpojax.flight import stage_use
from rpojax.flight.mission.mission_state import AbortReason
from rpojax.flight.stages import Stages
from rpojax.metrics import metric_catalogue
from rpojax.physics import equipment_faults
from rpojax.report.labels import metric_label
from rpojax.scenario import schema
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.numbers import key_units
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import LampSection, StartSection, WideLensSection
from rpojax.sensors.additional.registry import sensor_classes, sensor_names
from rpojax.simulation import channels
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.metrics import decimated_traces
from rpojax.simulation.rollout import rollout
from rpojax.simulation.step import step
from rpojax.value_types import Section

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SCENARIO_PAGE = (ROOT / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")
FOLDER_PAGE = (ROOT / "docs" / "reference" / "campaign_folder.md").read_text(encoding="utf-8")
CONVENTIONS_PAGE = (ROOT / "docs" / "reference" / "conventions.md").read_text(encoding="utf-8")
RANDOM_NUMBERS_PAGE = (ROOT / "docs" / "theory" / "random_numbers.md").read_text(encoding="utf-8")
COMMANDS_PAGE = (ROOT / "docs" / "reference" / "command_line.md").read_text(encoding="utf-8")
PACKAGED_PAGE = (ROOT / "docs" / "reference" / "packaged_scenarios.md").read_text(encoding="utf-8")
PYTHON_PAGE = (ROOT / "docs" / "how_to" / "python.md").read_text(encoding="utf-8")
FLIGHT_PAGE = (ROOT / "docs" / "how_to" / "flight_software.md").read_text(encoding="utf-8")
SCRIPT = ROOT / ".ci" / "run"

MAIN_JOB = (
    "python3 -m venv .venv && .venv/bin/pip install -q . && "
    ".venv/bin/rpojax campaign inspection --runs 500 --seed 0 --out out/inspection"
)
TESTS = "python3 -m venv .venv && .venv/bin/pip install -q -e '.[dev]' && .venv/bin/python -m pytest -n 2"

SUBPACKAGES = {path.name for path in (ROOT / "rpojax").iterdir() if path.is_dir()}
FOLDERS = ("docs", "notebooks", "experiments", "benchmarks", "tests")
PAGES = sorted([*ROOT.glob("*.md"), *(page for folder in FOLDERS for page in (ROOT / folder).rglob("*.md"))])


def section(text: str, heading: str) -> str:
    """The part of a page under a heading, up to the next one of any level."""
    found = re.search(rf"^#+ {re.escape(heading)}$\n(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"no heading {heading!r}"
    return found[1]


def first_cells(text: str) -> list[str]:
    """First cell of every row of the tables in a text, head and rule left out."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    cells = [row.strip("|").split("|")[0].strip() for row in rows]
    return [cell for index, cell in enumerate(cells) if index > 1]


def quoted(text: str) -> list[str]:
    """Everything in single backquotes."""
    return re.findall(r"`([^`\n]+)`", text)


def blocks(text: str, language: str) -> list[str]:
    """Fenced blocks of a language."""
    return [block.text for block in code_blocks(text) if block.language == language]


def sections_of_the_schema() -> dict[str, type[Section]]:
    """Name -> model of every section of a scenario."""
    fields = ScenarioFile.model_fields.items()
    models = {name: field.annotation for name, field in fields} | {
        name: sensor_classes(name)[0] for name in sensor_names()
    }
    models |= {
        "start": StartSection,
        "lamp": LampSection,
        "wide_lens": WideLensSection,
    }  # a scenario may be without these
    return {name: model for name, model in models.items() if isinstance(model, type) and issubclass(model, Section)}


def kinds(union: Any) -> dict[str, set[str]]:
    """Kind -> its settings; the key, the kind and what all kinds have left out."""
    return {
        get_args(model.model_fields["kind"].annotation)[0]: set(model.model_fields) - {"key", "kind", "common"}
        for model in get_args(get_args(union)[0])
    }


@pytest.mark.parametrize("command", [MAIN_JOB, TESTS])
def test_the_readme_has_each_of_its_two_command_lines_once_on_a_line_of_its_own(command: str) -> None:
    assert README.splitlines().count(command) == 1


def test_ci_runs_the_test_command_of_the_readme_in_another_environment() -> None:
    commands = [line for line in SCRIPT.read_text(encoding="utf-8").splitlines() if "pytest" in line]
    assert [command.replace('"', "").replace("$venv", ".venv") for command in commands] == [TESTS]


def test_the_ci_script_is_executable_and_well_formed() -> None:
    assert os.access(SCRIPT, os.X_OK)
    subprocess.run(["bash", "-n", str(SCRIPT)], check=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_lead_to_files_and_headings_that_are_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    broken = []
    for link in links:
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert broken == []


def anchors(page: Path) -> set[str]:
    """Names by which the headings of a page can be linked to."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_every_packaged_scenario_is_mentioned(name: str) -> None:
    assert f"`{name}`" in PACKAGED_PAGE
    assert f"`{name}`" in SCENARIO_PAGE


def test_the_page_on_commands_lists_the_exit_statuses_that_the_command_line_has() -> None:
    from rpojax.cli import main

    rows = [cell for cell in first_cells(section(COMMANDS_PAGE, "Exit status")) if cell.isdigit()]
    assert rows == ["0", "1", "2", "3", "4", "130", "143"]
    assert {1, *map(int, main.Status)} == {int(row) for row in rows}
    # The help of the command says the same numbers.
    described = re.search(r"Exit status: (.*?)\n\n", main.__doc__ or "", re.DOTALL)
    assert described
    assert re.findall(r"(?:^|; )(\d+) ", described[1].replace("\n", " ")) == rows


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_verb_that_a_page_uses_is_one_of_the_command_line(page: Path) -> None:
    from rpojax.cli import main

    text = "\n".join([*blocks(page.read_text(encoding="utf-8"), ""), *quoted(page.read_text(encoding="utf-8"))])
    verbs = set(re.findall(r"\brpojax ([a-z][a-z-]*)\b", text))
    known = {*main.COMMANDS}
    assert verbs <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_names_of_the_package_in_the_code_of_a_page_exist(page: Path) -> None:
    code = "\n".join(blocks(page.read_text(encoding="utf-8"), "python"))
    ast.parse(code)
    assert {
        name for name in re.findall(r"\brpojax\.(\w+)", code) if name not in {*rpojax.__all__, *SUBPACKAGES}
    } == set()


def test_the_replaceable_parts_on_the_page_for_python_are_those_of_the_flight_software() -> None:
    named = quoted(section(PYTHON_PAGE, "Your own controller or filter"))
    assert set(Stages.__dataclass_fields__) <= set(named)


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 120


def test_the_scenario_files_of_the_page_on_changes_are_accepted(tmp_path: Path) -> None:
    change, dispersion = blocks((ROOT / "docs" / "how_to" / "change_a_scenario.md").read_text(encoding="utf-8"), "toml")
    path = tmp_path / "closer.toml"
    path.write_text(change)
    assert scenario_loader.load(path).name == "closer"
    path.write_text('extends = "inspection"\n' + dispersion)
    *base, added = [drawn.key for drawn in scenario_loader.load(path).dispersions]
    assert added == "gps.noise_m"
    assert base == [drawn.key for drawn in scenario_loader.load("inspection").dispersions]
    assert scenario_loader.load(path, ["dispersions=[]"]).dispersions == []


def test_the_scenario_of_the_fields_page_is_accepted(tmp_path: Path) -> None:
    [text] = blocks((ROOT / "docs" / "how_to" / "field.md").read_text(encoding="utf-8"), "toml")
    path = tmp_path / "kepler.toml"
    path.write_text(text)
    file = scenario_loader.load(path)
    assert file.camera.model == "rendered"
    assert file.imaging.field == str(tmp_path / "kepler.field.safetensors")
    assert len(file.target.hull_m) >= 4


def test_the_options_on_the_fields_page_are_those_of_its_commands() -> None:
    import inspect

    from rpojax.cli.options import vision

    page = (ROOT / "docs" / "how_to" / "field.md").read_text(encoding="utf-8")
    code = "\n".join([*blocks(page, ""), *quoted(page)])
    verbs = (vision.TrainFieldCommand, vision.EvaluateFieldCommand, vision.RenderFieldCommand)
    records = (vision.LandmarksCommand, vision.PortOptions, vision.MeshPlacement, vision.FreshViews)
    names = {name for each in (*verbs, *records) for name in inspect.signature(each).parameters}
    known = {name.replace("_", "-") for name in names}
    assert set(re.findall(r"--([a-z][a-z-]*)", code)) <= known | {"json"}


def headings_of_sections() -> list[str]:
    """Headings of the scenario page that name sections; like sections share one."""
    return re.findall(r"^## (`.*`)$", SCENARIO_PAGE, re.MULTILINE)


LISTS_AND_DESIGN = ("design", "dispersions", "faults", "phases", "requirements", "servicers", "thrusters")
"""What has headings of its own beside the sections of the schema."""


def test_the_scenario_page_lists_every_section_once() -> None:
    named = [name for heading in headings_of_sections() for name in quoted(heading)]
    assert sorted(named) == sorted(
        [
            *sections_of_the_schema(),
            *LISTS_AND_DESIGN,
        ]
    )


@pytest.mark.parametrize("name", sections_of_the_schema())
def test_the_scenario_page_lists_every_key_of_a_section_that_is_no_declared_number_and_no_other(name: str) -> None:
    heading = next(heading for heading in headings_of_sections() if name in quoted(heading))
    listed = [key for cell in first_cells(section(SCENARIO_PAGE, heading)) for key in quoted(cell)]
    fields = sections_of_the_schema()[name].model_fields
    assert sorted(listed) == sorted(key for key, field in fields.items() if not field.description)


def test_the_scenario_page_names_every_kind_of_fault() -> None:
    text = section(SCENARIO_PAGE, "`faults`")
    assert set(equipment_faults.KINDS) <= set(quoted(text.partition("Kinds:")[2]))


def test_the_scenario_page_lists_the_keys_at_the_top_level() -> None:
    listed = {cell.strip("`") for cell in first_cells(section(SCENARIO_PAGE, "Top level"))}
    assert listed == set(ScenarioFile.model_fields) - {
        *sections_of_the_schema(),
        *LISTS_AND_DESIGN,
    }


def test_the_scenario_page_lists_every_key_of_a_requirement() -> None:
    listed = [cell.strip("`") for cell in first_cells(section(SCENARIO_PAGE, "`requirements`"))]
    assert listed == list(schema.RequirementSection.model_fields)


def test_the_scenario_page_says_how_many_runs_verify() -> None:
    text = section(SCENARIO_PAGE, "`requirements`").replace("\n", " ")
    said = re.search(r"At (\S+) and a risk of (\S+) verification takes (\d+) runs[^,]+, (\d+) with one, (\d+)", text)
    assert said
    probability, risk, *runs = map(float, said.groups())
    assert runs == [runs_for_bound(probability, 1.0 - risk, rank) for rank in (1, 2, 3)]


def test_the_page_on_statistics_says_how_many_runs_verify() -> None:
    page = (ROOT / "docs" / "theory" / "statistics.md").read_text(encoding="utf-8")
    rows = [list(map(float, line.strip("| ").split("|"))) for line in page.splitlines() if line.startswith("| 0.9")]
    assert len(rows) == 3
    for probability, risk, *runs in rows:
        assert runs == [runs_for_bound(probability, 1.0 - risk, rank) for rank in (1, 2, 3)]


@pytest.mark.parametrize(
    ("heading", "union"),
    [("`dispersions`", Dispersion), ("`design`", Design)],
    ids=["dispersion", "design"],
)
def test_the_scenario_page_lists_every_kind_with_its_settings(heading: str, union: Any) -> None:
    rows = [line.strip("|").split("|") for line in section(SCENARIO_PAGE, heading).splitlines()]
    listed = {row[0].strip(" `"): set(quoted(row[1])) for row in rows if len(row) > 1 and "`" in row[0]}
    assert listed == kinds(union)


def test_the_scenarios_of_the_scenario_page_are_accepted(tmp_path: Path) -> None:
    start, handover, goal, team, faults, derived, grid, requirement = blocks(SCENARIO_PAGE, "toml")
    (tmp_path / "iss.tle").write_text(TLE)
    (tmp_path / "start.toml").write_text(start)
    assert scenario_loader.load(tmp_path / "start.toml").start is not None
    path = tmp_path / "mine.toml"
    path.write_text('extends = "inspection"\n' + handover)
    assert scenario_loader.load(path).initial.handover is not None
    path.write_text('extends = "vbar_approach"\n' + goal)
    assert scenario_loader.load(path).goal.phase == "approach"
    path.write_text('extends = "safety_ellipse"\n' + team)
    assert [each.name for each in scenario_loader.load(path).servicers] == ["leader", "follower"]
    path.write_text('extends = "inspection"\n' + faults)
    assert [each.name for each in scenario_loader.load(path).faults] == ["tracker", "wheel"]
    path.write_text('extends = "inspection"\n' + derived)
    assert scenario_loader.load(path).dispersions[-1].kind == "derived"
    path.write_text('extends = "inspection"\n' + requirement)
    assert [each.window.suffix for each in scenario_loader.load(path).requirements] == ["@2000-end"]
    path.write_text('extends = "inspection_cold"\n' + grid)
    with pytest.raises(RpojaxError, match=r"^design.values: found 'servicer.mass_kg'"):
        scenario_loader.load(path)
    assert scenario_loader.load(path, ["dispersions=[]"]).design.kind == "grid"


def test_keys_named_anywhere_in_the_pages_exist() -> None:
    names = "|".join(sections_of_the_schema())
    for page in PAGES:
        # Of Python code the texts in quotes alone: other names with a point are attributes.
        text = re.sub(
            r"```python\n.*?```",
            lambda block: "`" + " ".join(re.findall(r'"[^"`]*"', block[0])) + "`",
            page.read_text(encoding="utf-8"),
            flags=re.DOTALL,
        )
        code = "\n".join(re.findall(r"`+[^`]+`+", text))
        for name, key in re.findall(rf"(?<![\w/.])({names})\.([a-z]\w*)\b(?!\()(?!\.py)", code):
            module = ROOT / "rpojax" / name
            if not module.exists():
                assert key in sections_of_the_schema()[name].model_fields, f"{page.name}: {name}.{key}"


def test_the_conventions_list_every_unit_suffix() -> None:
    rows = [line.split("|")[1] for line in section(CONVENTIONS_PAGE, "Units").splitlines() if line.startswith("| `")]
    assert {suffix for row in rows for suffix in quoted(row)} == set(key_units.UNITS)


def test_the_page_on_random_numbers_lists_every_random_stream() -> None:
    listed = [cell.strip("`") for cell in first_cells(section(RANDOM_NUMBERS_PAGE, "Randomness"))]
    assert listed == [stream.name for stream in Stream]


def test_the_folder_page_lists_every_metric_with_its_unit() -> None:
    rows = [line.strip("|").split("|") for line in section(FOLDER_PAGE, "Metrics").splitlines() if "| `" in line]
    assert {row[0].strip(" `"): row[1].strip() for row in rows} == metric_catalogue.UNITS


@pytest.mark.parametrize("name", metric_catalogue.UNITS)
def test_the_report_has_a_title_and_a_meaning_for_every_metric(name: str) -> None:
    assert metric_label(name).meaning


def test_the_folder_page_names_every_trace() -> None:
    assert set(decimated_traces.TRACE_UNITS) == set(quoted(section(FOLDER_PAGE, "Traces")))


def test_the_folder_page_lists_every_channel_of_a_history() -> None:
    static, params, state = initialise_run(scenario_loader.load("inspection"))
    seen = jax.eval_shape(lambda: compute_channels(static, params, step(static, params, state, Stages())[1]))
    assert names_listed("Channels of a history") == {
        "time_s",
        "rho_desired_H",
        *seen,
        *channels.MISSION_CHANNELS,
        *channels.PLUME_CHANNELS,
        *channels.ISOLATION_CHANNELS,
        *channels.LENS_CHANNELS,
        *channels.LANDMARK_CHANNELS,
        *channels.PORT_CHANNELS,
        *channels.TEAM_CHANNELS,
        *channels.PHASING_CHANNELS,
    } - {"running"}


def test_the_folder_page_lists_the_further_channels_of_images() -> None:
    static, params, state = initialise_run(scenario_loader.load("inspection"))

    def channels(model: str) -> set[str]:
        seen = replace(static, camera_model=model)

        def observe() -> Channels:
            return compute_channels(seen, params, step(static, params, state, Stages())[1])

        return set(jax.eval_shape(observe))

    assert names_listed("Of images") == channels("rendered") - channels("geometric")


def names_listed(heading: str) -> set[str]:
    """Names in the first column of the table under a heading of the folder page."""
    return {name for cell in first_cells(section(FOLDER_PAGE, heading)) for name in quoted(cell)}


def test_the_licence_is_the_one_that_the_package_states() -> None:
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert 'license = "Apache-2.0"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_changelog_has_the_present_version() -> None:
    assert f"## [{rpojax.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_no_page_names_a_folder_of_one_machine() -> None:
    notebook = json.loads((ROOT / "notebooks" / "inspection.ipynb").read_text(encoding="utf-8"))
    texts = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
    texts["inspection.ipynb"] = json.dumps([cell.get("source") for cell in notebook["cells"]])
    assert {name for name, text in texts.items() if re.search(r"(?<![\w.])/(tmp|home|root|Users|work)/", text)} == set()


@pytest.mark.slow
def test_the_stages_of_the_page_on_flight_software_act_in_the_loop() -> None:
    replaced: dict[str, Any] = {}
    # Those with a memory of their own and a picture: tests/campaign/test_filter_of_ones_own.py.
    for block in (each for each in blocks(FLIGHT_PAGE, "python") if not re.search(r"\bown\b|\bpicture\b", each)):
        names: dict[str, Any] = {}
        exec(compile(block, "flight_software.md", "exec"), names)
        stages = names["stages"]
        replaced |= {
            each.name: getattr(stages, each.name)
            for each in fields(Stages)
            if getattr(stages, each.name) != each.default
        }
    assert set(replaced) == {"formation_law", "wheel_torque", "orbit_update", "reference", "mission_manager"}
    tables = scenario_loader.load("inspection", ["initial.relative_position_m=[0, -70, 0]"]).model_dump()
    phase = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -70.0, 0.0]}}
    file = scenario_loader.validate(tables | {"phases": [phase]})
    _, telemetry = jax.jit(rollout, static_argnums=(0, 3, 4))(*initialise_run(file), 3, Stages(**replaced))
    assert bool(telemetry.frame.box.present.any())
    assert not bool(telemetry.innovation.sensors["box"].accepted.any())  # the target is farther than 60 m
    mission = telemetry.flight.mission
    assert bool((mission.abort_reason == AbortReason.COMMAND).all())
    raised = mission.entry.relative_state[:, :3] + jnp.array([[0.0, 0.0, 5.0]])
    assert jnp.allclose(telemetry.rho_desired_H, raised, rtol=0.0, atol=1e-12)
    assert bool(jnp.isfinite(telemetry.truth.r_ST_N).all())


def test_the_page_on_flight_software_says_which_replaced_stages_are_refused_where() -> None:
    lines = section(FLIGHT_PAGE, "Where replaced stages are used").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")][1:]
    expected = [
        [
            mode.name,
            ", ".join(f"`{stage}`" for stage in mode.refused) or "none",
            "; ".join(dict.fromkeys(mode.refused.values())),
        ]
        for mode in stage_use.MODES
    ]
    assert rows == expected


def test_the_page_on_flight_software_names_every_stage_with_its_arguments() -> None:
    rows = [line.strip("|").split("|") for line in FLIGHT_PAGE.splitlines() if line.startswith("| `")]
    found = {cells[0].strip(" `"): quoted(cells[2]) for cells in rows}
    for each in fields(Stages):
        arguments = inspect.signature(each.metadata["protocol"].__call__).parameters
        assert found.pop(each.name) == [name for name in arguments if name != "self"]
    assert not found
