"""CONTRIBUTING.md says where things live; the tree and its docstrings decide."""

import ast
from pathlib import Path

from test_import_directions import FLOORS, MODULES

PAGE = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
MOST_PARAMETERS = 10
"""More are fields of a record."""
LONGEST_FUNCTION_LINES = 62
"""What a screen shows."""


def summary(module: str) -> str:
    """First paragraph of a module's docstring, in one line, without the floor that it may name first."""
    text = ast.get_docstring(ast.parse(MODULES[module].read_text(encoding="utf-8"))) or ""
    first = " ".join(text.split("\n\n")[0].split()).rstrip(".")
    return first.split(": ", 1)[1] if first.startswith("Floor ") else first


def row(module: str) -> str:
    """Line of the table for a folder or a module at the top of the package."""
    top, *below = module.split(".")
    path = "rpojax/" + module.replace(".", "/")
    path += "/" if MODULES[module].name == "__init__.py" else ".py"
    return f"| {FLOORS[top] if not below else ''} | `{path}` | {summary(module)} |"


def expected() -> list[str]:
    """Rows from the highest floor down, each folder followed by its sub-folders."""
    shown = [name for name, path in MODULES.items() if name and ("." not in name or path.name == "__init__.py")]
    return [row(name) for name in sorted(shown, key=lambda name: (-FLOORS[name.partition(".")[0]], name))]


def test_the_table_of_folders_is_that_of_the_tree() -> None:
    found = [line for line in PAGE.splitlines() if "| `rpojax/" in line]
    assert found == expected(), "expected:\n" + "\n".join(expected())


def test_every_folder_and_module_says_what_it_is() -> None:
    assert [name for name in MODULES if name and len(summary(name)) < 20] == []


def test_no_function_needs_scrolling() -> None:
    long = [
        f"{module}.{node.name}"
        for module, path in MODULES.items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno >= LONGEST_FUNCTION_LINES
    ]
    assert long == []


def parameter_count(function: ast.FunctionDef) -> int:
    """Number of parameters, keywords included."""
    found = function.args
    return len(found.posonlyargs) + len(found.args) + len(found.kwonlyargs)


def test_a_function_with_many_options_takes_them_as_a_record() -> None:
    counts = {
        f"{module}.{node.name}": parameter_count(node)
        for module, path in MODULES.items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    many = {name: count for name, count in counts.items() if count > MOST_PARAMETERS}
    # Public calls whose keywords are the fields of a record.
    assert many == {
        "analysis.gradients.scenario_gradient.gradient": 12,
        "analysis.gradients.tuning.tune.tune": 12,
        "analysis.reliability.worst_case.worst_case": 11,
        "campaign.run_and_resume.run_campaign": 13,
    }
