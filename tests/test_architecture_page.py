"""docs/reference/architecture.md names files and functions that exist."""

import ast
import re
from pathlib import Path

import pytest
from test_import_directions import PACKAGE

PAGE = (Path(__file__).parents[1] / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"`([^`\n]+)`", PAGE)
PATHS = sorted({text for text in QUOTED if re.fullmatch(r"[a-z_0-9/]+(\.py|/)", text)})
FUNCTIONS = sorted({text for text in QUOTED if re.fullmatch(r"[a-z_0-9]+\.[a-z_0-9]+", text)} - {"campaign.json"})
IN_MODULE = sorted(set(re.findall(r"`([A-Za-z_]+)`\s+(?:\([^)`]*|in\s+)`([a-z_0-9/]+\.py)`", PAGE)))


def definitions(path: Path) -> set[str]:
    """Names of functions and classes at the top of a module."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    return {node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}


@pytest.mark.parametrize("path", PATHS)
def test_a_path_on_the_page_exists(path: str) -> None:
    assert (PACKAGE / path).exists()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_on_the_page_exists(name: str) -> None:
    module, function = name.split(".")
    homes = [path for path in PACKAGE.rglob(f"{module}.py") if str(path.relative_to(PACKAGE)) in PATHS]
    assert any(function in definitions(path) for path in homes)


@pytest.mark.parametrize(("name", "path"), IN_MODULE)
def test_a_name_that_the_page_puts_into_a_module_is_there(name: str, path: str) -> None:
    assert name in definitions(PACKAGE / path)


def test_the_page_names_enough_to_be_a_map() -> None:
    assert len(PATHS) > 40
    assert len(FUNCTIONS) >= 5
    assert len(IN_MODULE) >= 12


CONTRIBUTING = re.findall(r"`([^`\n]+)`", (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "path", sorted({text for text in CONTRIBUTING if re.fullmatch(r"[a-z_0-9]+/[a-z_0-9/]+\.py", text)})
)
def test_a_path_in_the_contributing_guide_exists(path: str) -> None:
    assert (PACKAGE / path).exists() or (PACKAGE.parent / path).exists()


@pytest.mark.parametrize(
    "name",
    sorted(
        {text for text in CONTRIBUTING if re.fullmatch(r"[a-z_]+\.[A-Za-z]\w+", text)}
        - {"jnp.linalg", "pyproject.toml"}
    ),
)
def test_a_name_in_the_contributing_guide_exists(name: str) -> None:
    module, found = name.split(".")
    sources = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob(f"{module}.py")]
    assert any(re.search(rf"^(def|class) {found}\b|^{found}\b.*=", source, re.MULTILINE) for source in sources)
