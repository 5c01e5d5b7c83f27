"""Errors of the schema as one line that names the key, what was found and what was expected."""

from typing import Any

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError, UnknownKeyError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the nominal scenario, free to be changed."""
    return inspection_file.model_dump()


@pytest.mark.parametrize(
    ("section", "misspelt", "meant"),
    [
        ("servicer", "mas_kg", "servicer.mass_kg"),
        ("navigation", "gate_sigmas", "navigation.gate_sigma"),
        (None, "servicr", "servicer"),
    ],
)
def test_the_error_of_a_misspelt_key_suggests_the_right_one(
    tables: dict[str, Any], section: str | None, misspelt: str, meant: str
) -> None:
    (tables[section] if section else tables)[misspelt] = 1.0
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    key = f"{section}.{misspelt}" if section else misspelt
    assert isinstance(caught.value, UnknownKeyError)
    assert caught.value.key == key
    assert str(caught.value) == f"{key}: unknown key (did you mean {meant!r}?)"


@pytest.mark.parametrize("key", ["servicer.mass_kg", "camera", "duration_s"])
def test_a_missing_key_is_named(tables: dict[str, Any], key: str) -> None:
    section, _, name = key.partition(".")
    if name:
        del tables[section][name]
    else:
        del tables[section]
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables)
    assert_one_line(caught.value, key, "a value")


GOOD_REQUIREMENT: dict[str, Any] = {
    "metric": "min_range_m", "bound": "at least", "limit": 15.0, "probability": 0.99, "consumer_risk": 0.1
}  # fmt: skip


def test_the_error_of_a_misspelt_key_of_a_requirement_suggests_the_right_one(tables: dict[str, Any]) -> None:
    tables["requirements"] = [GOOD_REQUIREMENT | {"limits": 3.0}]
    with pytest.raises(UnknownKeyError) as caught:
        scenario_loader.validate(tables)
    assert str(caught.value) == "requirements.0.limits: unknown key (did you mean 'limit'?)"
