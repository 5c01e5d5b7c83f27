"""Imports of optional packages."""

import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from rpojax.errors import RpojaxError
from rpojax.optional_packages import EXTRAS, MissingExtraError, require_package

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", EXTRAS)
def test_missing_package_error_names_the_command_that_installs_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as error:
        require_package(name)
    assert isinstance(error.value, RpojaxError)
    assert str(error.value) == f"{name}: not installed, expected: pip install 'rpojax[{EXTRAS[name]}]'"


def test_extras_contain_the_packages_that_they_are_said_to_install() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    distributions = packages_distributions()
    for name, extra in EXTRAS.items():
        required = {re.split(r"[<>=]", requirement)[0] for requirement in extras[extra]}
        installed = [distribution.replace("_", "-") for distribution in distributions.get(name, required)]
        assert required.intersection(installed), name


def test_missing_packages_are_handled_in_one_module() -> None:
    handlers = re.compile("ImportError|ModuleNotFoundError|find_spec")
    modules = {path.name for path in (ROOT / "rpojax").rglob("*.py") if handlers.search(path.read_text())}
    assert modules == {"optional_packages.py"}
