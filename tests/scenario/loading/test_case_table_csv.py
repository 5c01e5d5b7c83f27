"""CSV files of case tables: refused with the row, the key and the reason."""

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_variants import write_with_table

from rpojax.errors import ScenarioError
from rpojax.physics.plant_options import is_fault_kind
from rpojax.scenario.loading import case_table_csv, scenario_loader
from rpojax.untrusted.file_reading import FileKind


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "row 1: missing"),
        ("\n\n", "row 1"),
        ("gps.noise_m\n", "row 2: missing"),
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
        ("faults.fault.kind\nno_such_fault\n", "design.values.faults.fault.kind"),
        ("faults.fault.wheel\n1\n0.5\n", "design.values.faults.fault.wheel"),
        ("servicer.mass_kg\n30\n", "found 'servicer.mass_kg', expected a key that nothing else gives values to"),
        ("thruster.position_m[1]\n0\n", "found 'thruster.position_m[1]', expected a key that nothing else"),
        ("thruster.direction[0]\n1\n0\n", "design.values.thruster.direction"),
    ],
)
def test_an_invalid_table_is_refused_with_its_row_or_key(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario_loader.load(write_with_table(tmp_path, text))
    assert named in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_table_too_large_or_unreadable_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_with_table(tmp_path, "gps.noise_m\n1\n2\n3\n")
    monkeypatch.setattr(case_table_csv, "MAX_CELLS", 3)
    with pytest.raises(ScenarioError, match="at most 1000 columns and 3 values"):
        scenario_loader.load(path)
    monkeypatch.undo()
    with (tmp_path / "runs.csv").open("ab") as stream:
        stream.truncate(FileKind.CASE_TABLE.most_bytes + 1)
    with pytest.raises(ScenarioError, match="more than 64000000 bytes"):
        scenario_loader.load(path)
    (tmp_path / "runs.csv").write_bytes(b"gps.noise_m\n\xff\n")
    with pytest.raises(ScenarioError, match="UTF-8"):
        scenario_loader.load(path)
    (tmp_path / "runs.csv").unlink()
    with pytest.raises(ScenarioError, match=r"^design.file.*expected a readable CSV file"):
        scenario_loader.load(path)
    os.mkfifo(tmp_path / "runs.csv")
    with pytest.raises(ScenarioError, match=r"^design.file.*expected a readable CSV file"):
        scenario_loader.load(path)


cells = st.one_of(
    st.text(max_size=8),
    st.floats(allow_nan=True, allow_infinity=True).map(str),
    st.sampled_from(
        ["gps.noise_m", "faults.fault.kind", '"', ",", "\n", "\r", "\x00", "1", "", "none", "gps.noise_m[0]"]
    ),
)


@given(
    st.one_of(
        st.binary(max_size=200),
        st.lists(cells, max_size=30).map(lambda parts: ",".join(parts).encode("utf-8", "replace")),
    )
)
def test_any_bytes_give_a_table_of_finite_numbers_or_a_scenario_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(content)
    try:
        columns = case_table_csv.read_columns(path)
    except ScenarioError as refused:
        assert "expected" in str(refused)
        return
    assert len({len(values) for values in columns.values()}) == 1
    for key, values in columns.items():
        assert is_fault_kind(key) or all(math.isfinite(value) for value in values if isinstance(value, float))
