"""JSON and TOML beyond the limits on structure are refused, others are read as by the standard library."""

import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpojax.scenario.loading import scenario_loader
from rpojax.untrusted import structure_limits
from rpojax.untrusted.json_reading import parse_json
from rpojax.untrusted.structure_limits import StructureError
from rpojax.untrusted.toml_reading import MOST_KEY_PARTS, MOST_KEYS, parse_toml


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("extends = \u201cinspection\u201d\n", "U+201C (LEFT DOUBLE QUOTATION MARK)"),
        ("extends\u00a0= 1\n", "U+00A0 (NO-BREAK SPACE)"),
        ("a = 1\ndur\u0430tion_s = 600\n", "U+0430 (CYRILLIC SMALL LETTER A)"),
        ("a = \uff16\n", "U+FF16 (FULLWIDTH DIGIT SIX)"),
        ("a = 1\n\ue000 = 2\n", "U+E000 (without a name)"),
    ],
)
def test_a_character_that_only_looks_right_is_named(text: str, name: str) -> None:
    with pytest.raises(StructureError) as caught:
        parse_toml(text)
    assert f"the character {name}" in str(caught.value)


@pytest.mark.parametrize(
    "text", ["NaN", "[1e999]", "1" + "0" * 400, "9" * 5000, "[" * 100_000, "[" * 80 + "]" * 80, ""]
)
def test_json_beyond_the_limits_is_refused(text: str) -> None:
    with pytest.raises(StructureError):
        parse_json(text)


@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers(-(2**63), 2**63)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
        max_leaves=10,
    )
)
def test_other_json_is_read_unchanged(content: object) -> None:
    assert parse_json(json.dumps(content)) == content


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (".".join(["a"] * (MOST_KEY_PARTS + 1)) + " = 1", "parts of a key"),
        ("[" + ".".join(["a"] * (MOST_KEY_PARTS + 1)) + "]", "parts of a key"),
        ('"' + '"."'.join(["a,="] * (MOST_KEY_PARTS + 1)) + '" = 1', "parts of a key"),
        ("\n".join(f"k{n} = 1" for n in range(MOST_KEYS + 1)), "keys"),
        ("a = {" + ",".join(f"k{n}=1" for n in range(MOST_KEYS + 1)) + "}", "keys"),
        ("a = " + "[" * 100_000, "deep"),
        ("a = " + "[" * 80 + "]" * 80, "64 levels"),
        ("a = 1" + "0" * 400, "64 bits"),
        ("a = " + "9" * 5000, "digits"),
        ("a = ", "Invalid value"),
    ],
)
def test_toml_beyond_the_limits_is_refused(text: str, found: str) -> None:
    with pytest.raises(StructureError, match=found):
        parse_toml(text)


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_packaged_scenarios_are_read_unchanged(name: str) -> None:
    text, _ = scenario_loader._read_text(name)
    assert parse_toml(text) == tomllib.loads(text)


def test_signs_in_texts_and_comments_do_not_count() -> None:
    text = "a = '" + "=.{," * 20_000 + "'  # " + "=." * 20_000 + '\nb = """' + "=.\n" * 10_000 + '"""\n'
    assert parse_toml(text) == tomllib.loads(text)


def test_too_many_values_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structure_limits, "MOST_VALUES", 10)
    with pytest.raises(StructureError, match="more than 10 values"):
        parse_json("[1,2,3,4,5,6,7,8,9,10,11]")
