"""Tables, grids, correlated and derived dispersions: read as meant, and refused with one line where they are wrong."""

import math
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpojax.errors import ScenarioError
from rpojax.scenario import dispersion_keys
from rpojax.scenario.loading import case_table_csv, scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile


def validate(file: ScenarioFile, **tables: Any) -> ScenarioFile:
    """`file` with other sections, and nothing dispersed unless it is given."""
    return scenario_loader.validate(file.model_dump() | {"dispersions": []} | tables)


def write(folder: Path, text: str, design: str = 'kind = "table"\nfile = "runs.csv"\n') -> Path:
    """A scenario with a table beside it."""
    (folder / "runs.csv").write_text(text)
    (folder / "mine.toml").write_text(f'extends = "inspection"\n[design]\n{design}')
    return folder / "mine.toml"


TABLE = "gps.noise_m, formation.desired_position_m[1] ,fault.kind\n1.5,-30,none\n 2e0 ,-.25e2,gps_outage\n\n"


def test_a_table_lies_beside_its_scenario_and_becomes_part_of_it(tmp_path: Path) -> None:
    file = scenario_loader.load(write(tmp_path, TABLE))
    values = {
        "gps.noise_m": [1.5, 2.0],
        "formation.desired_position_m[1]": [-30.0, -25.0],
        "fault.kind": ["none", "gps_outage"],
    }
    assert file.design.model_dump() == {"kind": "table", "file": "", "values": values}
    assert dispersion_keys.varied_keys(file)[-3:] == ["gps.noise_m", "formation.desired_position_m", "fault.kind"]
    (tmp_path / "runs.csv").unlink()
    again = scenario_loader.validate(file.model_dump(mode="json"))
    assert again == file
    assert scenario_digest(again) == scenario_digest(file)


def test_a_table_of_a_spreadsheet_and_of_another_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "excel.csv").write_bytes(b'\xef\xbb\xbf"gps.noise_m"\r\n1\r\n2\r\n')
    path = write(tmp_path, TABLE, 'kind = "table"\nfile = "deeper/excel.csv"\n')
    assert scenario_loader.load(path).design.model_dump()["values"] == {"gps.noise_m": [1.0, 2.0]}
    other = scenario_loader.load(path, [f"design.file={tmp_path / 'runs.csv'}"])
    assert len(other.design.model_dump()["values"]) == 3


def test_a_file_that_extends_another_replaces_its_design(tmp_path: Path) -> None:
    base = write(tmp_path, TABLE)
    (tmp_path / "next.toml").write_text(f'extends = "{base.name}"\n[design]\nkind = "sobol"\n')
    assert scenario_loader.load(tmp_path / "next.toml").design.kind == "sobol"
    assert scenario_loader.load("inspection", ["design.kind=latin_hypercube"]).design.kind == "latin_hypercube"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "row 1: found 'nothing'"),
        ("\n\n", "row 1"),
        ("gps.noise_m\n", "row 2: found 'nothing'"),
        ("gps.noise_m,gps.noise_m\n1,2\n", "row 1: found 'gps.noise_m', expected distinct"),
        ("gps.noise_m,\n1,2\n", "row 1"),
        ("gps.noise_m,thruster.force_n\n1\n", "row 2: found '1 fields', expected 2"),
        ("gps.noise_m\n1\n\n2\n", "row 3: found '0 fields'"),
        ("gps.noise_m\nnan\n", "row 2: found 'nan', expected a finite number for gps.noise_m"),
        ("gps.noise_m\n1\n1e999\n", "row 3: found '1e999'"),
        ("gps.noise_m\ninf\n", "row 2"),
        ("gps.noise_m\n1_0\n", "row 2"),
        ("gps.noise_m\n0x10\n", "row 2"),
        ("gps.noise_m\n\u0661\n", "row 2"),
        ('gps.noise_m\n"1\n', "row 2"),
        ("gps.noise_m\n-1\n2\n", "design.values.gps.noise_m: found -1.0, expected what gps.noise_m can be"),
        ("gps.nose_m\n1\n", "design.values.gps.nose_m: found 'gps.nose_m', expected the key"),
        ("camera.width_px\n64\n", "design.values.camera.width_px"),
        ("formation.desired_position_m\n1\n", "expected one column for each component"),
        ("formation.desired_position_m[3]\n1\n", "design.values.formation.desired_position_m[3]"),
        ("gps.noise_m[0]\n1\n", "design.values.gps.noise_m[0]"),
        ("servicer.inertia_kg_m2[0]\n1\n", "design.values.servicer.inertia_kg_m2[0]"),
        ("fault.kind\nno_such_fault\n", "design.values.fault.kind"),
        ("fault.wheel\n1\n0.5\n", "design.values.fault.wheel"),
        ("servicer.mass_kg\n30\n", "found 'servicer.mass_kg', expected a key that nothing else gives values to"),
        ("thruster.position_m[1]\n0\n", "found 'thruster.position_m[1]', expected a key that nothing else"),
        ("thruster.direction[0]\n1\n0\n", "design.values.thruster.direction"),
    ],
)
def test_a_table_that_is_none_is_refused_with_its_row_or_key(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario_loader.load(write(tmp_path, text))
    assert named in str(refused.value)
    assert "\n" not in str(refused.value)


def test_tables_too_large_or_out_of_reach_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "gps.noise_m\n1\n2\n3\n")
    monkeypatch.setattr(case_table_csv, "MAX_CELLS", 3)
    with pytest.raises(ScenarioError, match="at most 1000 columns and 3 values"):
        scenario_loader.load(path)
    monkeypatch.setattr(case_table_csv, "MAX_BYTES", 5)
    with pytest.raises(ScenarioError, match="at most 5 bytes"):
        scenario_loader.load(path)
    monkeypatch.undo()
    (tmp_path / "runs.csv").write_bytes(b"gps.noise_m\n\xff\n")
    with pytest.raises(ScenarioError, match="UTF-8"):
        scenario_loader.load(path)
    (tmp_path / "runs.csv").unlink()
    with pytest.raises(ScenarioError, match=r"^design.file.*expected a CSV file"):
        scenario_loader.load(path)
    os.mkfifo(tmp_path / "runs.csv")
    with pytest.raises(ScenarioError, match=r"^design.file.*expected a CSV file"):
        scenario_loader.load(path)


def test_a_table_is_read_by_load_alone(inspection_file: ScenarioFile, tmp_path: Path) -> None:
    """A scenario from elsewhere, such as a campaign's, cannot have a file of this machine read."""
    (tmp_path / "runs.csv").write_text(TABLE)
    with pytest.raises(ScenarioError, match=r"^design.file"):
        validate(inspection_file, design={"kind": "table", "file": str(tmp_path / "runs.csv")})
    both = 'kind = "table"\nfile = "runs.csv"\n[design.values]\n"gps.noise_m" = [1.0]\n'
    with pytest.raises(ScenarioError, match=r"^design.file: found .*expected no file beside values"):
        scenario_loader.load(write(tmp_path, TABLE, both))
    for values in ({}, {"gps.noise_m": []}, {"gps.noise_m": [1.0], "gps.bias_sigma_m": [1.0, 2.0]}):
        with pytest.raises(ScenarioError, match=r"^design.values"):
            validate(inspection_file, design={"kind": "table", "values": values})


cells = st.one_of(
    st.text(max_size=8),
    st.floats(allow_nan=True, allow_infinity=True).map(str),
    st.sampled_from(["gps.noise_m", "fault.kind", '"', ",", "\n", "\r", "\x00", "1", "", "none", "gps.noise_m[0]"]),
)


@given(
    st.one_of(
        st.binary(max_size=200),
        st.lists(cells, max_size=30).map(lambda parts: ",".join(parts).encode("utf-8", "replace")),
    )
)
def test_whatever_a_table_holds_it_is_a_table_of_finite_numbers_or_a_scenario_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "hostile.csv"
    path.write_bytes(content)
    try:
        columns = case_table_csv.read_columns(path)
    except ScenarioError as refused:
        assert "expected" in str(refused)
        return
    assert len({len(values) for values in columns.values()}) == 1
    for key, values in columns.items():
        assert key == case_table_csv.TEXT_KEY or all(
            math.isfinite(value) for value in values if isinstance(value, float)
        )


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({}, "design.values"),
        ({"gps.noise_m": []}, "design.values.gps.noise_m"),
        ({"gps.noise_m": ["a"]}, "design.values.gps.noise_m.0"),
        ({"gps.noise_m": [math.inf]}, "design.values.gps.noise_m.0"),
        ({"gps.noise_m": [[1.0]]}, "design.values.gps.noise_m"),
        ({"gps.noise_m": [1.0, -1.0]}, "design.values.gps.noise_m"),
        ({"initial.relative_position_m": [[1.0, 2.0]]}, "design.values.initial.relative_position_m"),
        ({"target.attitude": [[0.0, 0.0, 0.0, 0.0]]}, "design.values.target.attitude"),
        ({"gps.noise_m": [1.0], "gps": {"noise_m": [1.0]}}, "design.values.gps"),
        ({"target.tumble_axis": [[0.0, 0.0, 1.0]], "target.tumble_axis[0]": [1.0]}, "design.values"),
    ],
    ids=str,
)
def test_a_grid_that_is_none_is_refused(inspection_file: ScenarioFile, values: Any, named: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        validate(inspection_file, design={"kind": "grid", "values": values})
    assert str(refused.value).startswith(f"{named}: found")


@pytest.mark.parametrize(
    "design",
    [{}, {"kind": "random"}, {"kind": "sobol", "values": {}}, {"kind": "independent", "file": "a.csv"}, 3],
    ids=str,
)
def test_a_design_of_no_kind_or_with_settings_of_another_is_refused(inspection_file: ScenarioFile, design: Any) -> None:
    with pytest.raises(ScenarioError, match=r"^design"):
        validate(inspection_file, design=design)


def correlated(keys: list[str], covariance: list[list[float]]) -> dict[str, Any]:
    return {"kind": "correlated_normal", "keys": keys, "covariance": covariance}


def derived(key: str, *terms: str, offset: Any = 0.0) -> dict[str, Any]:
    return {"kind": "derived", "key": key, "offset": offset, "terms": [{"key": term, "factor": 1.0} for term in terms]}


ONE = [[1.0]]
PAIR = ["gps.noise_m", "thruster.force_n"]


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        ([correlated(PAIR, [[1.0, 0.5], [0.4, 1.0]])], "dispersions.0.covariance: found .* expected a symmetric"),
        ([correlated(PAIR, [[1.0, 1.5], [1.5, 1.0]])], "positive semidefinite"),
        ([correlated(PAIR, [[1.0, 1.5e-3], [1.5e-3, 1e-6]])], "positive semidefinite"),
        ([correlated(PAIR, [[-1.0, 0.0], [0.0, 1.0]])], "positive semidefinite"),
        ([correlated(PAIR, [[1.0, 0.0]])], "as many columns as rows"),
        ([correlated(PAIR, ONE)], "dispersions.0.covariance: found '1 rows', expected one for each of the 2"),
        ([correlated(["initial.relative_position_m"], ONE)], "each of the 3"),
        ([correlated(["gps.noise"], ONE)], "dispersions.0.keys: found 'gps.noise', expected the key"),
        ([correlated(["servicer.inertia_kg_m2"], ONE)], "dispersions.0.keys"),
        ([correlated(["fault.kind"], ONE)], "dispersions.0.keys"),
        (
            [correlated(["gps.noise_m", "gps.noise_m"], [[1.0, 0.0], [0.0, 1.0]])],
            "a key that no other dispersion draws",
        ),
        (
            [correlated(["thruster.position_m[1]"], ONE), derived("thruster.position_m", "thruster.tank_position_m")],
            "no other",
        ),
        ([derived("gps.noise_m", "gps.noise_m")], r"dispersions: found \['gps.noise_m'\]"),
        ([derived("gps.noise_m", "gps.bias_sigma_m"), derived("gps.bias_sigma_m", "gps.noise_m")], "end in others"),
        (
            [
                derived("thruster.position_m[1]", "thruster.position_m[0]"),
                derived("thruster.position_m[0]", "thruster.position_m[1]"),
            ],
            "end in others",
        ),
        ([derived("gps.noise_m", "thruster.position_m")], r"dispersions.0.terms.0.key"),
        ([derived("gps.noise_m", "gps.noise")], r"dispersions.0.terms.0.key"),
        ([derived("gps.noise_m")], r"dispersions.0.terms"),
        ([derived("thruster.position_m", "gps.noise_m", offset=[1.0, 2.0])], r"dispersions.0.offset"),
        ([derived("fault.wheel", "gps.noise_m")], r"dispersions.0.kind"),
        ([derived("gps.noise_m", "fault.kind")], r"dispersions.0.terms.0.key"),
    ],
)
def test_correlated_and_derived_dispersions_that_cannot_be_are_refused(
    inspection_file: ScenarioFile, entries: list[dict[str, Any]], named: str
) -> None:
    with pytest.raises(ScenarioError, match=named) as refused:
        validate(inspection_file, dispersions=entries)
    assert "\n" not in str(refused.value)


def test_components_of_one_vector_may_follow_one_another(inspection_file: ScenarioFile) -> None:
    entries = [
        derived("thruster.position_m[2]", "thruster.position_m[1]"),
        derived("thruster.position_m[1]", "thruster.position_m[0]"),
        correlated(["thruster.position_m[0]", "gps.noise_m"], [[1e-6, 1e-6], [1e-6, 1e-6]]),
    ]
    file = validate(inspection_file, dispersions=entries)
    assert [dispersion_keys.dispersion_name(entry) for entry in dispersion_keys.evaluation_order(file)] == [
        "thruster.position_m[0]+gps.noise_m",
        "thruster.position_m[1]",
        "thruster.position_m[2]",
    ]
    assert dispersion_keys.varied_keys(file) == ["thruster.position_m", "gps.noise_m"]


def test_an_extension_replaces_correlated_dispersions_of_the_same_keys_only(tmp_path: Path) -> None:
    head = '[[dispersions]]\nkind = "correlated_normal"\n'
    base, more = tmp_path / "base.toml", tmp_path / "more.toml"
    base.write_text(
        f'extends = "inspection"\n{head}keys = ["gps.noise_m"]\ncovariance = [[1.0]]\n'
        f'{head}keys = ["gps.bias_sigma_m"]\ncovariance = [[1.0]]\n'
    )
    more.write_text(f'extends = "base.toml"\n{head}keys = ["gps.noise_m"]\ncovariance = [[4.0]]\n')
    found = {dispersion_keys.dispersion_name(entry): entry for entry in scenario_loader.load(more).dispersions}
    assert found["gps.noise_m"].model_dump()["covariance"] == [[4.0]]
    assert "gps.bias_sigma_m" in found
    assert len(found) == len(scenario_loader.load(base).dispersions)
