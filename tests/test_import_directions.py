"""Who may import whom: lower floors, or modules to the left in the same folder."""

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "rpojax"

FLOORS = {
    "errors": 0,
    "version": 0,
    "core": 1,
    "physics": 2,
    "flight": 2,
    "vision": 2,
    "sensors": 3,
    "training": 3,
    "simulation": 4,
    "campaign": 5,
    "analysis": 6,
    "report": 7,
    "interop": 7,
    "top": 8,
}
"""Floor of every folder; the modules of the command line, which lie beside the folders, count as the folder `top`."""

LEFT_TO_RIGHT = {
    "core": "constants pytree safe gaussian series quaternion frames difference orbital_mechanics ephemeris light "
    "compensated course integrate",
    "physics": "effects environment actuators rigid_body faults plant",
    "vision": "pinhole box_model rays grid_field grid_build point_field field region render exposure weights "
    "sheets turntable background overlap layers first_look second_look detector pictures search imager",
    "flight": "onboard navigation covariance box_gate servicer_filter relative_filter orbit_filter attitude_estimator "
    "formation_control attitude_control pointing slew looking burn_plan search guidance thrust_gauge computer",
    "sensors": "gps star_tracker gyro chamber_pressure box_camera image_camera statistical_camera statistics_file",
    "training": "optional target_mesh raytrace checkpoint train_field judge shapes spacecraft sprites backdrops "
    "composites detection_data augment average_precision detector_judge orthogonal descent giou first_look_loss "
    "second_look_loss train_detector",
    "simulation": "units figures_of_merit forms sections schema dispersed dispersion_checks checks networks table_file "
    "scenario params noise camera run_state tick_stages closed_loop telemetry stepwise running_metrics metrics",
    "campaign": "files admission description manifests encoding reading creation store design sources dispersions "
    "normal_space traces per_device engine plan retention recording replaced flying executors cluster runner rerun "
    "stopwatch cold_start operations benchmark orbit_benchmark filter_benchmark vision_benchmark measuring",
    "analysis": "chance laws order_statistics proportions precision consistency dependence sensitivity requirements "
    "comparison convergence describing_function outlines linear_inputs linear_state linear_sources linear_start "
    "linear_loop linear_recursion linear_decision linear_setup linear_side linear_covariance linear_agreement "
    "error_budget derivatives metric_bound limit_trials derivative_sensitivity design_point worst_case "
    "worst_case_record tunable objective slopes tuning judging camera_calibration lasting_errors",
    "interop": "frames topics message_types tick_values messages shown_values flight_record ros_bag "
    "rerun_chunks rerun_scene rerun_camera rerun_plots rerun_layout rerun_log dds_types participant "
    "live_topics commands given_estimate ledger exchange live_settings pace orders live_program live_words live",
    "top": "machine console outputs verb_parts plan_verb compare_verb lincov_verb tune_verb campaign_verbs field_verbs "
    "detector_verbs calibration_verb sensitivity_verb worst_case_verb flown_again bag_verb rrd_verb bridge_verb "
    "bench_verb cli __main__",
}
"""Order inside a folder, for the modules whose order is fixed; the rest need only have one."""


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name below the package; a folder stands for its `__init__`."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(module: str) -> Iterator[str]:
    """Modules of the package that `module` imports, wherever in it the import stands."""
    package = ["rpojax", *module.split(".")]
    if MODULES[module].name != "__init__.py":
        package.pop()
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            origin = ".".join([*base, *filter(None, [node.module])])
            names = [f"{origin}.{alias.name}" for alias in node.names]
        for name in names:
            if name.partition(".")[0] == "rpojax":
                yield deepest(name.removeprefix("rpojax").removeprefix("."))


def deepest(name: str) -> str:
    """The module that an imported name lives in: the name itself or the longest prefix that is a module."""
    while name not in MODULES:
        name = name.rpartition(".")[0]
    return name


def place(module: str) -> tuple[str, str]:
    """Folder and name of a module."""
    folder, _, name = module.partition(".")
    return (folder, name) if name or folder in FLOORS else ("top", folder)


def fault(importer: str, imported: str) -> str | None:
    """Why `importer` may not import `imported`, or None if it may."""
    folder, module = place(importer)
    other_folder, other_module = place(imported)
    if imported == "":
        return None  # the package itself holds only its version and names that load late
    if folder != other_folder:
        below = FLOORS[other_folder] < FLOORS[folder]
        return None if below else f"{importer} (floor {FLOORS[folder]}) imports {imported} ({FLOORS[other_folder]})"
    order = LEFT_TO_RIGHT.get(folder, "").split()
    if module in order and other_module in order and order.index(other_module) >= order.index(module):
        return f"{importer} imports {imported}, which stands to its right"
    return None


def test_every_folder_of_the_package_has_a_floor() -> None:
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} <= set(FLOORS)


def test_every_module_beside_the_folders_has_its_order() -> None:
    beside = {name for name in MODULES if name and "." not in name} - set(FLOORS)
    assert beside <= set(LEFT_TO_RIGHT["top"].split())


@pytest.mark.parametrize("module", [name for name in MODULES if name])
def test_a_module_imports_only_from_lower_floors_or_from_its_left(module: str) -> None:
    assert [text for imported in imports(module) if (text := fault(module, imported))] == []


@pytest.mark.parametrize("folder", sorted({place(name)[0] for name in MODULES if name}))
def test_the_modules_of_a_folder_can_be_put_in_an_order_from_left_to_right(folder: str) -> None:
    inside = [name for name in MODULES if name and place(name)[0] == folder]
    graph = {name: {other for other in imports(name) if other in inside and other != name} for name in inside}
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("core.frames", "physics.plant"),
        ("flight.computer", "physics.actuators"),
        ("physics.plant", "vision.pinhole"),
        ("flight.guidance", "sensors.gps"),
        ("core.constants", "core.orbital_mechanics"),
        ("simulation.scenario", "simulation.params"),
        ("errors", "core.safe"),
        ("report.html", "cli"),
        ("console", "cli"),
    ],
)
def test_the_rules_refuse_what_they_are_meant_to_refuse(importer: str, imported: str) -> None:
    assert fault(importer, imported) is not None


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("cli", "report.html"),
        ("cli", "console"),
        ("report.html", "errors"),
        ("sensors.box_camera", "physics.environment"),
        ("flight.computer", "flight.guidance"),
    ],
)
def test_the_rules_allow_what_they_are_meant_to_allow(importer: str, imported: str) -> None:
    assert fault(importer, imported) is None
