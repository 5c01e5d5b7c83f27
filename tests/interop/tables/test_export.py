"""Exported tables, read back by pandas, pyarrow, SciPy and NumPy, against the campaign's arrays."""

import csv
import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow.parquet
import pytest
import scipy.io

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import main
from rpojax.errors import Notice, OutputError, RpojaxError
from rpojax.interop import campaign_tables
from rpojax.interop.campaign_tables import TABLE_NAMES
from rpojax.interop.export import ExportOptions, export, export_as

Tables = dict[str, dict[str, np.ndarray]]


def read_csv(out: Path) -> Tables:
    """Tables of CSV files, by pandas, with its exact conversion of text."""
    frames = {
        name: pandas.read_csv(out.with_name(f"{out.stem}_{name}.csv"), float_precision="round_trip")
        for name in TABLE_NAMES
    }
    return {name: {str(column): frame[column].to_numpy() for column in frame} for name, frame in frames.items()}


def read_parquet(out: Path) -> Tables:
    found: Tables = {}
    for name in TABLE_NAMES:
        table = pyarrow.parquet.read_table(out.with_name(f"{out.stem}_{name}.parquet"))
        found[name] = {column: table[column].to_pandas().to_numpy() for column in table.column_names}
    return found


def read_mat(out: Path) -> Tables:
    content = scipy.io.loadmat(out, squeeze_me=True)
    head, *rows = content["columns"].tolist()
    assert head == ["table", "column", "field", "unit", "meaning"]
    return {
        name: {column: np.atleast_1d(content[name][field].item()) for table, column, field, *_ in rows if table == name}
        for name in TABLE_NAMES
    }


def read_npz(out: Path) -> Tables:
    with np.load(out, allow_pickle=False) as content:
        return {
            name: {key.removeprefix(f"{name}/"): content[key] for key in content if key.startswith(f"{name}/")}
            for name in TABLE_NAMES
        }


READERS: dict[Any, Any] = {"csv": read_csv, "parquet": read_parquet, "mat": read_mat, "npz": read_npz}


@pytest.mark.parametrize("form", READERS)
def test_every_number_is_read_back_by_another_library(form: Any, three_runs: Campaign, tmp_path: Path) -> None:
    out = tmp_path / f"results.{form}"
    paths = export(three_runs, out, form, TABLE_NAMES)
    assert all(path.is_file() for path in paths)
    found = READERS[form](out)
    for name, values in three_runs.metrics.items():
        np.testing.assert_array_equal(found["metrics"][name].astype(float), values, err_msg=name)
    assert found["metrics"]["outcome"].tolist() == three_runs.outcomes.tolist()
    np.testing.assert_array_equal(found["metrics"]["completed"].astype(bool), three_runs.completed)
    for name, values in three_runs.drawn.items():
        columns = [values] if values.ndim == 1 else list(values.reshape(3, -1).T)
        own = [column for key, column in found["draws"].items() if key == name or key.startswith(f"{name}[")]
        np.testing.assert_array_equal(np.array(own, dtype=float), columns, err_msg=name)
    samples = len(three_runs.trace_time_s)
    for name, values in three_runs.traces.items():
        read = found["traces"][name].astype(np.float32).reshape(3, samples)
        np.testing.assert_array_equal(read, values, err_msg=name)
    np.testing.assert_array_equal(found["traces"]["run_id"].reshape(3, samples)[:, 0], three_runs.run_ids)
    ticks = len(three_runs.history(0)["time_s"])
    for place, run_id in enumerate(three_runs.history_ids):
        rows = slice(place * ticks, (place + 1) * ticks)
        for axis in range(3):
            read = found["history"][f"rho_H[{axis}]"][rows].astype(np.float32)
            np.testing.assert_array_equal(read, three_runs.history(run_id)["rho_H"][:, axis])
        np.testing.assert_array_equal(found["history"]["run_id"][rows], run_id)


def test_every_column_has_its_unit_in_every_format(three_runs: Campaign, tmp_path: Path) -> None:
    for form in READERS:
        export(three_runs, tmp_path / f"r.{form}", form, TABLE_NAMES)
    with (tmp_path / "r_columns.csv").open(newline="") as stream:
        units = {(row["table"], row["column"]): row["unit"] for row in csv.DictReader(stream)}
    assert units["metrics", "delta_v_m_s"] == "m/s"
    assert units["draws", "target.tumble_rate_deg_s"] == "deg/s"
    assert units["history", "rho_H[1]"] == "m"
    assert units["history", "nees"] == "1"
    for name in TABLE_NAMES:
        schema = pyarrow.parquet.read_schema(tmp_path / f"r_{name}.parquet")
        assert {(name, field.name): field.metadata[b"unit"].decode() for field in schema} == {
            key: unit for key, unit in units.items() if key[0] == name
        }
        about = json.loads(schema.metadata[b"rpojax"])
        assert about["scenario_hash"] == three_runs.configuration.scenario_hash
    rows = scipy.io.loadmat(tmp_path / "r.mat", squeeze_me=True)["columns"].tolist()[1:]
    assert {(table, column): unit for table, column, _, unit, _ in rows} == units
    with np.load(tmp_path / "r.npz") as content:
        assert {(row[0], row[1]): row[2] for row in content["columns"].tolist()[1:]} == units


def test_the_same_results_give_the_same_bytes(three_runs: Campaign, tmp_path: Path) -> None:
    for form in ("csv", "npz", "parquet"):
        first, second = (export(three_runs, tmp_path / f"{n}.{form}", form, ["metrics"])[0] for n in "ab")
        assert first.read_bytes() == second.read_bytes()


def test_undefined_numbers_are_empty_in_csv_and_null_in_parquet(three_runs: Campaign, tmp_path: Path) -> None:
    export(three_runs, tmp_path / "r.csv", what=["metrics"])
    with (tmp_path / "r.csv").open(newline="") as stream:
        assert [row["failed_at_s"] for row in csv.DictReader(stream)] == ["", "", ""]
    [path] = export(three_runs, tmp_path / "r.parquet", what=["metrics"])
    assert pyarrow.parquet.read_table(path)["failed_at_s"].null_count == 3


def test_one_run_is_exported_alone(three_runs: Campaign, tmp_path: Path) -> None:
    export(three_runs, tmp_path / "r.npz", what=["metrics", "history"], run_id=2)
    with np.load(tmp_path / "r.npz") as content:
        assert content["metrics/run_id"].tolist() == [2]
        assert set(content["history/run_id"].tolist()) == {2}


def test_tables_of_an_unfinished_campaign_say_how_many_runs_they_lack(three_runs: Campaign, tmp_path: Path) -> None:
    part = tmp_path / "part"
    shutil.copytree(three_runs.directory, part)
    (part / "manifest" / "000001.json").unlink()
    with pytest.warns(Notice, match="part: found 2 of 3 runs finished, expected all"):
        export(part, tmp_path / "all.csv", what=["metrics"])
    with warnings.catch_warnings():
        warnings.simplefilter("error", Notice)
        export(part, tmp_path / "one.csv", what=["metrics"], run_id=0)
        export(three_runs, tmp_path / "whole.csv", what=["metrics"])


def test_names_of_fields_are_those_of_matlab_and_differ() -> None:
    names = campaign_tables.mat_names(
        ["servicer.mass_kg", "servicer mass_kg", "0_first", "a" * 70, "a" * 71, "rho_H[0]"]
    )
    assert list(names.values())[:3] == ["servicer_mass_kg", "servicer_mass_kg_2", "x_0_first"]
    assert len(set(names.values())) == 6
    assert all(name.isidentifier() and len(name) <= 63 for name in names.values())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"what": []}, "what: found ''"),
        ({"run_id": 7}, "run_id: found 7"),
        ({"what": ["history"], "run_id": 1}, "run 1: found no history"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    arguments: dict[str, Any], expected: str, three_runs: Campaign, tmp_path: Path
) -> None:
    with pytest.raises(RpojaxError, match=expected):
        export(three_runs, tmp_path / "r.csv", **arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", ["oem", "aem", "opm", "czml"])
def test_tables_of_a_format_without_them_are_refused(
    form: str, three_runs: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(three_runs.directory), "--format", form, "--run-id", "0", "--out", str(tmp_path / "run")]
    assert main.main([*command, "--what", "history"]) == 2
    expected = f"nothing for {form.upper()}; csv, parquet, mat, npz have tables"
    assert capsys.readouterr().err == f"rpojax: error: --what: found 'history', expected {expected}\n"
    assert list(tmp_path.iterdir()) == []


def test_one_table_has_a_row_for_each_run_with_metrics_and_draws(three_runs: Campaign, tmp_path: Path) -> None:
    path, columns = export(three_runs, tmp_path / "r.csv")
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["run_id"]) for row in rows] == [0, 1, 2]
    assert [row["outcome"] for row in rows] == three_runs.outcomes.tolist()
    for name, values in three_runs.metrics.items():
        found = [float(row[name]) if row[name] else np.nan for row in rows]
        np.testing.assert_array_equal(found, values, err_msg=name)
    position = three_runs.drawn["initial.relative_position_m"]
    assert [float(row["initial.relative_position_m[1]"]) for row in rows] == position[:, 1].tolist()
    with columns.open(newline="") as stream:
        described = list(csv.DictReader(stream))
    assert [each["column"] for each in described] == list(rows[0])
    assert {each["column"]: each["unit"] for each in described}["initial.relative_position_m[1]"] == "m"


def test_an_existing_file_is_replaced_only_by_force(three_runs: Campaign, tmp_path: Path) -> None:
    (tmp_path / "r_draws.csv").write_text("mine")
    both = ("metrics", "draws")
    with pytest.raises(OutputError, match=r"r_draws.csv: exists already"):
        export(three_runs, tmp_path / "r.csv", what=both)
    assert (tmp_path / "r_draws.csv").read_text() == "mine"
    export(three_runs, tmp_path / "r.csv", what=both, force=True)
    assert (tmp_path / "r_draws.csv").read_text().startswith("run_id,")


def test_the_command_prints_what_it_wrote(
    three_runs: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(three_runs.directory), "--format", "csv", "--out", str(tmp_path / "r.csv")]
    assert main.main(command) == 0
    names = [Path(line).name for line in capsys.readouterr().out.splitlines()]
    assert names == ["r.csv", "r_columns.csv"]
    with pytest.raises(RpojaxError, match="form: found 'xlsx'"):
        export_as(three_runs, tmp_path / "r.xlsx", "xlsx", ExportOptions())
    assert main.main([*command[:-1], str(tmp_path / "s.csv"), "--what", "metrics,nothing"]) == 2
    assert "--what: found 'nothing'" in capsys.readouterr().err
