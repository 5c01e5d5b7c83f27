"""Who may import whom: only lower floors, and no circles between modules or folders."""

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "rpojax"

FLOORS = {
    "errors": 0,
    "version": 0,
    "optional_packages": 0,
    "printable_text": 0,
    "summary_text": 0,
    "untrusted": 0,
    "time_scales": 0,
    "value_types": 0,
    "runtime": 0,
    "core": 1,
    "batching": 1,
    "physics": 2,
    "flight": 2,
    "vision": 2,
    "dispersions": 3,
    "sensors": 3,
    "training": 3,
    "metrics": 3,
    "scenario": 4,
    "simulation": 5,
    "campaign": 6,
    "analysis": 7,
    "benchmark": 7,
    "report": 8,
    "interop": 8,
    "cli": 9,
    "__main__": 10,
}
"""Floor of every folder and module at the top of the package."""


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


def fault(importer: str, imported: str) -> str | None:
    """Why `importer` may not import `imported`, or None if it may as far as floors are concerned."""
    top, other = importer.partition(".")[0], imported.partition(".")[0]
    if other in ("", top) or FLOORS[other] < FLOORS[top] or FLOORS[other] == FLOORS[top] == 0:
        return None  # the package itself holds only its version and names that load late
    return f"{importer} (floor {FLOORS[top]}) imports {imported} (floor {FLOORS[other]})"


def entries(folder: str) -> dict[str, set[str]]:
    """Entry of a folder (module or sub-folder) -> other entries of the same folder that something in it imports."""
    depth = len(folder.split(".")) if folder else 0
    prefix = f"{folder}." if folder else ""
    inside = [name for name in MODULES if name.startswith(prefix) and name != folder]
    graph: dict[str, set[str]] = {}
    for name in inside:
        entry = name.split(".")[depth]
        others = {other.split(".")[depth] for other in imports(name) if other in inside}
        graph.setdefault(entry, set()).update(others - {entry})
    return graph


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Entries that import each other, in order from one back to itself; none if there is no circle."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_everything_at_the_top_has_a_floor() -> None:
    assert {name.partition(".")[0] for name in MODULES if name} == set(FLOORS)


@pytest.mark.parametrize("module", [name for name in MODULES if name])
def test_a_module_imports_only_from_its_own_folder_or_lower_floors(module: str) -> None:
    assert [text for imported in imports(module) if (text := fault(module, imported))] == []


@pytest.mark.parametrize("folder", sorted(name for name, path in MODULES.items() if path.name == "__init__.py"))
def test_the_entries_of_a_folder_import_each_other_without_circles(folder: str) -> None:
    assert circle(entries(folder)) == []


def test_a_circle_is_found() -> None:
    assert set(circle({"a": {"b"}, "b": {"a"}, "c": {"a"}})) == {"a", "b"}
    assert "control" in entries("flight")["guidance"]


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("core.frames", "physics.plant"),
        ("runtime.programs_per_device", "core.frames"),
        ("flight.computer", "physics.plant"),
        ("physics.plant", "vision.pinhole"),
        ("flight.guidance.attitude_guidance", "sensors.gps"),
        ("dispersions.designs", "scenario.schema"),
        ("report.summary", "cli.main"),
    ],
)
def test_the_rules_refuse_what_they_are_meant_to_refuse(importer: str, imported: str) -> None:
    assert fault(importer, imported) is not None


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("cli.main", "report.labels"),
        ("report.labels", "errors"),
        ("sensors.geometric_camera", "physics.environment"),
        ("flight.computer", "flight.guidance.attitude_guidance"),
    ],
)
def test_the_rules_allow_what_they_are_meant_to_allow(importer: str, imported: str) -> None:
    assert fault(importer, imported) is None
