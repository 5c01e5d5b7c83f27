"""The sitting of benchmarks on an accelerator: budget, processes, partial results; its sections at small sizes."""

import dataclasses
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from benchmarks.accelerator import __main__ as command
from benchmarks.accelerator import (
    batch_sweep,
    loop_speed,
    memory,
    precision_statistics,
    result_table,
    section_list,
    sitting,
    sizes,
)
from benchmarks.accelerator.section_list import PLATFORM, SECTIONS, Section
from benchmarks.accelerator.sitting import MEASURED, OnEntry, Sitting
from rpojax.benchmark import closed_loop_speed

TINY = dataclasses.replace(sizes.SMALL, aim_runs=1, batches=(1, 2, 3), loop_duration_s=200.0, repeats=1)
FIRST, SECOND, THIRD = (Section(name, "none", 60.0) for name in ("first", "second", "third"))


class Clock:
    """A clock that a test advances."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def results(
    budget_s: float, backend: str = "gpu", status: str = MEASURED
) -> tuple[dict[str, Any], list[tuple[str, bool, float]], list[str]]:
    """Results of three sections that take 100 s each with two entries; what was run, and all states on the way."""
    clock, ran, states = Clock(), [], []

    def run_section(section: Section, small: bool, limit_s: float, on_entry: OnEntry) -> str:
        if section is PLATFORM:
            on_entry({"backend": backend, "machine": "some device"})
            return MEASURED
        ran.append((section.name, small, limit_s))
        for number in range(2):
            clock.now_s += 50.0
            on_entry({"batch": number, "run_s": 1.5})
        return status

    keep: Callable[[dict[str, Any]], None] = lambda content: states.append(json.dumps(content))  # noqa: E731
    return Sitting(budget_s, keep, run_section, clock).run([FIRST, SECOND, THIRD], small=False), ran, states


def test_sections_run_in_order_with_the_time_that_is_left() -> None:
    found, ran, _ = results(480.0)
    assert ran == [("first", False, 480.0), ("second", False, 380.0), ("third", False, 280.0)]
    assert [section["status"] for section in found["sections"]] == [MEASURED] * 3
    assert (found["elapsed_s"], found["sections"][1]["wall_s"]) == (300.0, 100.0)


def test_a_section_is_left_out_if_it_takes_longer_than_what_is_left() -> None:
    found, ran, _ = results(250.0)
    assert [name for name, _, _ in ran] == ["first", "second"]
    assert found["sections"][2]["status"] == "not measured: budget, 50 s left of 60 s"
    assert found["sections"][2]["entries"] == []


def test_results_are_kept_after_every_entry() -> None:
    _, _, states = results(480.0)
    counts = [[len(section["entries"]) for section in json.loads(state)["sections"]] for state in states]
    assert counts == [[1], [2], [2], [2, 1], [2, 2], [2, 2], [2, 2, 1], [2, 2, 2], [2, 2, 2]]


def test_a_failed_section_does_not_end_the_sitting() -> None:
    found, ran, _ = results(480.0, status="failed: no reason")
    assert len(ran) == 3
    assert found["sections"][0]["status"] == "failed: no reason"


@pytest.mark.parametrize(("backend", "small"), [("cpu", True), ("gpu", False)])
def test_sizes_are_small_on_a_cpu(backend: str, small: bool) -> None:
    found, ran, _ = results(480.0, backend)
    assert found["small"] is small
    assert {each for _, each, _ in ran} == {small}


def run_script(script: str) -> tuple[str, list[dict[str, Any]]]:
    """Status and entries of a Python script."""
    entries: list[dict[str, Any]] = []
    return sitting.run_command([sys.executable, "-c", script], 60.0, entries.append), entries


def test_entries_of_a_process_are_read_among_other_output() -> None:
    script = "print('compiling'); print('[1]'); print('[\"entry\", {\"batch\": 3}]')"
    assert run_script(script) == (MEASURED, [{"batch": 3}])


def test_a_process_that_fails_keeps_its_entries_and_gives_its_last_line() -> None:
    status, entries = run_script("print('[\"entry\", {}]', flush=True); raise ValueError('too bad')")
    assert (status, entries) == ("failed: ValueError: too bad", [{}])


class ManualTimer:
    """A timer that ends when a test says so."""

    latest: "ManualTimer"

    def __init__(self, _: float, end: Callable[[], None]) -> None:
        self.end = end
        ManualTimer.latest = self

    def start(self) -> None:
        """Nothing ends by itself."""

    def cancel(self) -> None:
        """Nothing has been started."""


def test_a_process_is_stopped_at_the_end_of_the_budget_and_keeps_its_entries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sitting.threading, "Timer", ManualTimer)
    script = "import time; print('[\"entry\", {}]', flush=True); time.sleep(600)"
    entries: list[dict[str, Any]] = []

    def end_budget(entry: dict[str, Any]) -> None:
        entries.append(entry)
        ManualTimer.latest.end()

    status = sitting.run_command([sys.executable, "-c", script], 60.0, end_budget)
    assert (status, entries) == ("not measured: budget, stopped after 60 s", [{}])


def test_every_section_has_a_module_that_measures() -> None:
    names = [section.name for section in SECTIONS]
    assert len(set(names)) == len(names)
    for section in (PLATFORM, *SECTIONS):
        assert callable(importlib.import_module(f"benchmarks.accelerator.{section.module}").measure)
        assert section_list.section_named(section.name) is section


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--budget-s", "0"], "--budget-s: found 0, expected a time above 0"),
        (["--budget-s", "nan"], "--budget-s: found nan, expected a time above 0"),
        (["--out", "{folder}/taken.json"], "--out: found {folder}/taken.json, expected a file that does not exist yet"),
    ],
)
def test_bad_options_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    (tmp_path / "taken.json").write_text("kept")
    assert command.main([word.format(folder=tmp_path) for word in words]) == 2
    assert capsys.readouterr().err.splitlines() == [f"accelerator: {message.format(folder=tmp_path)}"]


@pytest.mark.parametrize(("status", "exit_status"), [(MEASURED, 0), ("failed: ValueError", 3)])
def test_command_writes_and_prints_the_results(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    status: str,
    exit_status: int,
) -> None:
    def run_section(section: Section, small: bool, limit_s: float, on_entry: OnEntry) -> str:
        on_entry({"backend": "cpu"} if section is PLATFORM else {"batch": 7, "precision": "single", "run_s": 0.25})
        return MEASURED if section is PLATFORM else status

    monkeypatch.setattr(sitting, "run_in_process", run_section)
    out = tmp_path / "new" / "figures.json"
    assert command.main(["--json", "--only", "camera", "training", "--out", str(out)]) == exit_status
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(out.read_text())
    assert [section["name"] for section in printed["sections"]] == ["camera", "training"]
    assert list(out.parent.iterdir()) == [out]
    complete = [("camera", "batch 7, single", "run_s", "0.25"), ("training", "batch 7, single", "run_s", "0.25")]
    failed = [("camera", "", "status", status), ("training", "", "status", status)]
    expected = complete if exit_status == 0 else [complete[0], failed[0], complete[1], failed[1]]
    assert list(result_table.rows(printed)) == expected


def exhausted() -> dict[str, Any]:
    """A measurement that does not fit."""
    raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate\n 9 bytes.")


def test_only_exhausted_memory_is_an_entry_with_a_reason() -> None:
    assert memory.measured_or_reason(exhausted, batch=9) == {
        "batch": 9,
        "not_measured": "memory: RESOURCE_EXHAUSTED: Out of memory while trying to allocate 9 bytes.",
    }

    def broken() -> dict[str, Any]:
        raise jax.errors.JaxRuntimeError("INTERNAL: broken")

    with pytest.raises(jax.errors.JaxRuntimeError, match="broken"):
        memory.measured_or_reason(broken)


def test_no_batch_is_tried_that_is_larger_than_one_that_did_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def measure_batch(file: Any, batch: int, _: Any) -> dict[str, Any]:
        tried.append(batch)
        return {"run_s": 1.0} if batch == 1 else exhausted()

    monkeypatch.setattr(batch_sweep, "_measure_batch", measure_batch)
    first, second, third = batch_sweep.measure(TINY, "double")
    assert tried == [1, 2]
    assert first == {"batch": 1, "precision": "double", "run_s": 1.0}
    assert second["not_measured"].startswith("memory: RESOURCE_EXHAUSTED")
    assert third == {"batch": 3, "precision": "double", "not_measured": "memory: 2 runs did not fit"}


def test_differences_of_precisions_are_relative_to_the_spread_of_the_runs() -> None:
    double = {"error_m": np.arange(101.0), "same": np.ones(101), "failed": np.zeros(101, bool)}
    single = {"error_m": np.arange(101.0) + 0.5, "same": np.ones(101), "failed": np.arange(101) == 0}
    single["error_m"][100] = np.nan
    double["error_m"][99] = np.nan
    found = precision_statistics.compare(double, single)
    spread = np.std(np.arange(99.0), ddof=1)
    assert found["largest_mean_difference_in_standard_errors_of"] == "error_m"
    assert found["largest_mean_difference_in_standard_errors"] == pytest.approx(0.5 * np.sqrt(99) / spread)
    assert found["largest_percentile_difference_in_deviations"] == pytest.approx(0.5 / spread)
    assert found["metrics"]["error_m"]["defined_differently"] == 2
    assert found["failed_differently"] == 1
    assert "same" not in found["metrics"]


@pytest.fixture
def shared(programs: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The programs of other tests are used, and not dropped."""
    monkeypatch.setattr(jax, "clear_caches", lambda: None)
    yield


def test_figures_of_the_loop_are_those_of_its_engine(shared: None) -> None:
    (entry,) = loop_speed.measure(TINY, "double")
    json.dumps(entry, allow_nan=False)
    assert (entry["batch"], entry["precision"], entry["devices"]) == (1, "double", 1)
    assert entry["run_seconds_per_s"] == pytest.approx(TINY.loop_duration_s / entry["run_s"])
    assert entry["device_run_seconds_per_s"] > 0.0
    assert entry["trace_s"] > 0.0
    assert 0 < entry["kernels_per_tick_fewest"] <= entry["kernels_per_tick"]
    assert len(entry["contributions"]) == 10
    engine = closed_loop_speed.compile_engine(loop_speed.mission(TINY, "double"), 1)
    arguments = sum(leaf.nbytes for leaf in jax.tree.leaves(closed_loop_speed.prepare_runs(engine).device_inputs))
    assert entry["device_bytes_per_run"] > arguments
    assert entry["peak_device_bytes"] is None  # a CPU does not tell


@pytest.mark.slow
def test_a_small_sitting_measures_all_sections(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    assert command.main(["--small", "--budget-s", "3000", "--out", str(out)]) == 0
    found = json.loads(out.read_text())
    assert {section["status"] for section in found["sections"]} == {MEASURED}
    assert [len(section["entries"]) for section in found["sections"]] == [1, 1, 1, 1, 1, 1, 1, 2, 2]
    precision = found["sections"][2]["entries"][0]
    assert precision["failed_differently"] == 0
    assert precision["largest_mean_difference_in_standard_errors"] < 1.0
