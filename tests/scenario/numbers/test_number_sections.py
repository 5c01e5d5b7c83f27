"""One declaration on a record is a key of a scenario: its form, bounds, conversion, dispersion and row of the pages."""

import math
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from jaxtyping import Array
from pydantic import BaseModel, ValidationError, create_model

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.numbers.number_sections import is_variable, section_of
from rpojax.scenario.numbers.section_records import section_record
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.params import Params, declared_leaves
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import HandoverSection, LampSection, WideLensSection
from rpojax.value_types import ChangesOf, OptionalKeys, Section

sys.path.insert(0, str(Path(__file__).parents[3] / "docs"))

from site_extensions import key_table


@pytree
class Boom:
    """Boom with an instrument.

    Attributes:
        is_out: 1 if it is out
    """

    is_out: Array
    tilt: Array = number("angle from the face", unit="deg", at_least=0.0, below=90.0)
    tip: Array = number("position of its tip, B", unit="m", length=3, default=[0.0, 0.0, 1.0])
    damping: Array = number("damping ratio", above=0.0, default=0.1)
    joints: Array = number("number of joints", form=int, default=2)
    wear: Array | None = number("part that is worn", at_least=0.0, at_most=1.0, default=None)


class BoomSection(section_of(Boom, first=("model", "tip"), optional=True)):
    """Boom of the servicer."""

    model: str = "stiff"


@pytree
class Belief:
    """Record that holds a copy of another one."""

    boom: Boom


@pytree
class Craft:
    """Record that holds another one."""

    boom: Boom
    flight: Belief


WithBoom: Any = create_model("WithBoom", __base__=ScenarioFile, boom=(BoomSection, ...))


@pytest.fixture
def file(inspection_file: ScenarioFile) -> ScenarioFile:
    """Scenario with the section of the record."""
    return WithBoom(**inspection_file.model_dump(), boom={"tilt_deg": 30.0})


def test_the_keys_of_a_section_are_in_the_order_of_files() -> None:
    assert list(BoomSection.model_fields) == ["model", "tip_m", "tilt_deg", "damping", "joints", "wear"]
    assert BoomSection(tilt_deg=1.0).model_dump() == {
        "model": "stiff",
        "tip_m": [0.0, 0.0, 1.0],
        "tilt_deg": 1.0,
        "damping": 0.1,
        "joints": 2,
    }


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"tilt_deg": -1.0},
        {"tilt_deg": 90.0},
        {"tilt_deg": math.nan},
        {"tilt_deg": math.inf},
        {"tilt_deg": "30"},
        {"tilt_deg": 1.0, "damping": 0.0},
        {"tilt_deg": 1.0, "tip_m": [1.0, 2.0]},
        {"tilt_deg": 1.0, "tip_m": 1.0},
        {"tilt_deg": 1.0, "wear": 1.1},
        {"tilt_deg": 1.0, "is_out": 1.0},
        {"tilt": 1.0},
    ],
)
def test_a_value_that_the_declaration_excludes_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        BoomSection.model_validate(values)


@pytest.mark.parametrize("values", [{"tilt_deg": 0.0}, {"tilt_deg": 89.9, "wear": 1.0}, {"tilt_deg": 0, "wear": 0.0}])
def test_a_value_on_a_bound_that_is_included_is_accepted(values: dict[str, Any]) -> None:
    assert BoomSection.model_validate(values).tilt_deg == values["tilt_deg"]


def test_the_record_is_in_si(file: Any) -> None:
    record = section_record(Boom, file.boom.model_dump(), is_out=np.float64(1.0))
    assert float(record.tilt) == 30.0 * (math.pi / 180.0)
    assert record.tip.tolist() == [0.0, 0.0, 1.0]
    assert record.wear is None


def test_the_leaf_of_the_key_is_found() -> None:
    leaves = declared_leaves(Craft)
    assert leaves["boom.tilt_deg"] == (("boom", "tilt"), math.pi / 180.0)
    assert leaves["boom.tilt"] == (("boom", "tilt"), 1.0)
    assert "boom.is_out" not in leaves


def test_declared_numbers_may_be_dispersed_and_static_settings_may_not(file: ScenarioFile) -> None:
    assert nominal_of_key(file, "boom.tilt_deg") == 30.0
    assert nominal_of_key(file, "boom.tip_m") == [0.0, 0.0, 1.0]
    for key in ("boom.model", "boom.joints", "boom.wear", "boom.is_out", "boom.tilt"):
        assert nominal_of_key(file, key) is None, key


def test_the_pages_have_a_row_with_the_declared_meaning(file: Any) -> None:
    keys = BoomSection.model_json_schema()["properties"]
    rows = list(key_table._table("`boom`", "", list(keys), keys, file.boom.model_dump(), {}, file, "boom"))
    assert "| `boom.tilt_deg` | number ≥ 0, < 90 | `30.0` | yes | angle from the face |  |" in rows
    assert "| `boom.damping` | number > 0, default 0.1 | `0.1` | yes | damping ratio |  |" in rows


class Changes(BaseModel):
    """Keys of the section that differ."""

    boom: Annotated[OptionalKeys, ChangesOf(BoomSection)] | None = None


def test_changes_of_such_a_section_hold_some_of_its_keys_within_their_bounds() -> None:
    assert Changes.model_validate({"boom": {"damping": 0.2}}).model_dump() == {"boom": {"damping": 0.2}}
    with pytest.raises(ValidationError):
        Changes.model_validate({"boom": {"damping": -0.2}})


def test_an_unknown_unit_is_refused() -> None:
    @pytree
    class Odd:
        """Record with a unit that no key has."""

        speed: Array = number("speed", unit="furlong")

    with pytest.raises(TypeError, match=r"^Odd.speed: found the unit 'furlong'"):
        section_of(Odd)


def test_the_numbers_of_all_sections_are_the_leaves_of_the_parameters() -> None:
    file = scenario_loader.load("inspection")
    sections = {"initial.handover": HandoverSection()}
    sections |= {name: getattr(file, name) for name in ScenarioFile.model_fields}
    sections |= {"wide_lens": WideLensSection.model_construct(), "lamp": LampSection.model_construct()}
    keys = {
        f"{name}.{key}"
        for name, section in sections.items()
        if isinstance(section, Section)
        for key in type(section).model_fields
        if is_variable(type(section), key)
    }
    leaves = declared_leaves(Params)
    assert len(keys) > 150
    assert {leaves[key][0] for key in keys} == {path for path, _ in leaves.values()}
