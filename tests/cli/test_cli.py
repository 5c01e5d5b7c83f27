"""The command line as people and programs use it."""

import errno
import html
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from command_line_calls import Call, Outcome
from isolated_plugins import forgotten_plugins
from rewritten_campaigns import rewrite_campaign
from shared_compilation import shared_programs

import rpojax
from rpojax.campaign.execution import process_executor
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.storage import atomic_files
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import main
from rpojax.cli.commands.campaigns import bench, run_and_campaign
from rpojax.cli.options.campaigns import BenchCommand, RunCommand
from rpojax.errors import RpojaxError
from rpojax.runtime import jax_environment
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes import outcome_kinds

SHORT = ("--set", "duration_s=400")
SINGLY = ("--block-size", "1")
LONG = ("--runs", "40", *SHORT, *SINGLY, "--no-report")


@pytest.fixture(scope="module", autouse=True)
def programs() -> Iterator[None]:
    """Commands on the same scenario and block size use one pair of programs, compiled once."""
    with shared_programs():
        yield


def contents(directory: Path) -> dict[str, bytes]:
    """Every file of a folder, by its path in it."""
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


# Happy paths


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of three runs with its report; not to be changed by a test."""
    out = tmp_path_factory.mktemp("finished") / "runs"
    words = [
        "campaign",
        "inspection",
        "--runs",
        "3",
        "--histories",
        "0,2",
        *SHORT,
        *SINGLY,
        "--out",
        str(out),
        "--json",
    ]
    assert main.main(words) == 0
    return out


def test_a_campaign_leaves_results_and_report(finished: Path) -> None:
    names = {path.name for path in finished.iterdir()}
    assert names == {
        *("campaign.json", "scenario.toml", "manifest", "results.zarr"),
        *("report.html", "report.json", "figures"),
    }
    report = json.loads((finished / "report.json").read_text())
    outcomes = {**dict.fromkeys(map(str, outcome_kinds.Outcome), 0), "not_judged": 3}
    counts = {"requested": 3, "completed": 0, "failed": 0, "not_judged": 3, "missing": 0}
    assert report["runs"] == {**counts, "outcomes": outcomes}
    assert report["metrics"]["min_range_m"]["unit"] == "m"
    assert Campaign(finished).history_ids == [0, 2]
    assert Campaign(finished).file.duration_s == 400.0


def test_resuming_a_finished_campaign_changes_no_byte(call: Call, finished: Path) -> None:
    before = contents(finished)
    result = call("resume", finished, "--json")
    assert result.status == 0
    assert result.json["runs"]["not_judged"] == 3
    assert result.json["report"] == str(finished / "report.html")
    assert contents(finished) == before


def test_a_report_can_show_another_run(call: Call, finished: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(finished, tmp_path / "copy")
    (copy / "report.json").unlink()
    result = call("report", copy, "--run-id", 2, "--json")
    assert result.status == 0
    assert result.err == ""
    assert "Run 2 is the median one" in (copy / "report.html").read_text()
    assert {name: result.json[name] for name in ("runs", "metrics")}.items() <= json.loads(
        (copy / "report.json").read_text()
    ).items()


def test_a_brief_report_is_a_page_beside_the_report(call: Call, finished: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(finished, tmp_path / "copy")
    before = (copy / "report.html").read_bytes()
    result = call("report", copy, "--brief")
    assert result.status == 0
    assert f"report: {copy / 'brief.html'}" in result.out
    assert "page 4 of 4" in (copy / "brief.html").read_text()
    assert (copy / "report.html").read_bytes() == before


def test_a_table_for_people_says_what_came_out_and_where_it_is(call: Call, finished: Path) -> None:
    result = call("resume", finished)
    assert result.status == 0
    for text in (
        "inspection, 3 runs",
        "Formation error",
        "median",
        "p95",
        "p99",
        "0 completed, 0 failed, 3 not judged",
        "violated: Formation error at most 2 m",
        "needs 227 more runs: Minimum range",
    ):
        assert text in result.out
    assert f"report: {finished / 'report.html'}" in result.out


def test_one_run_by_its_number_is_that_run_of_the_campaign(call: Call, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    result = call("run", "inspection", "--run-id", 2, *SHORT, "--out", out)
    assert result.status == 0
    assert "inspection, 1 run" in result.out
    assert "value" in result.out
    alone, whole = Campaign(out), Campaign(finished)
    assert (alone.run_ids.tolist(), alone.history_ids, alone.info["block_size"]) == ([2], [2], 1)
    for name, values in whole.metrics.items():
        np.testing.assert_array_equal(alone.metrics[name], values[2:], err_msg=name)
    for name, values in whole.history(2).items():
        np.testing.assert_array_equal(alone.history(2)[name], values, err_msg=name)
    assert "Report of one run" in (page := (out / "report.html").read_text())
    assert "inspection, run 2" in page


def test_the_reports_command_flies_a_run_again_to_the_last_bit_without_the_overrides(
    call: Call, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = html.unescape((finished / "report.html").read_text())
    found = re.search(r"<dd>rpojax (rerun [^<]*) --run-id I --out DIR</dd>", page)
    assert found
    result = call(*shlex.split(found[1]), "--run-id", 2, "--out", "again", "--json")
    assert result.status == 0
    alone, whole = Campaign("again"), Campaign(finished)
    assert alone.info["scenario_hash"] == whole.info["scenario_hash"]
    for name, values in whole.history(2).items():
        np.testing.assert_array_equal(alone.history(2)[name], values, err_msg=name)
    for name, values in whole.metrics.items():
        np.testing.assert_array_equal(alone.metrics[name], values[2:], err_msg=name)


def test_a_name_is_shown_as_it_is_written(call: Call, finished: Path, tmp_path: Path) -> None:
    name = r"b[/x] [red]alarm $\foo$"
    copy = shutil.copytree(finished, tmp_path / "copy")
    rewrite_campaign(copy, name=name)
    result = call("report", copy)
    assert result.status == 0
    assert f"{name}, 3 runs" in result.out


def test_requirements_are_changed_with_a_record_that_the_report_shows(
    call: Call, finished: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(finished, tmp_path / "copy")
    file = tmp_path / "requirements.toml"
    settings = (
        'metric = "min_range_m"',
        'bound = "at least"',
        "limit = 1.0",
        "probability = 0.5",
        "consumer_risk = 0.2",
    )
    file.write_text("\n".join(["[[requirements]]", *settings]))
    assert call("report", copy, "--reason", "none").status == 2
    result = call("report", copy, "--requirements", file, "--reason", "a smaller bar", "--no-film", "--json")
    assert result.status == 0
    [found] = result.json["requirements"]
    assert (found["metric"], found["verdict"]) == ("min_range_m", "verified")
    assert "a smaller bar" in (copy / "report.html").read_text()
    assert call("resume", copy, "--json").json["requirements"] == [found]


def test_the_table_shows_the_bad_side_and_an_unfinished_campaign(call: Call, finished: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(finished, tmp_path / "copy")
    (copy / "manifest" / "000001.json").unlink()
    result = call("report", copy)
    assert result.status == 0
    rows = {line.split("│")[1].strip(): line for line in result.out.splitlines() if line.startswith("│")}
    assert "p5 " in rows["Minimum range"]
    assert "p1 " in rows["Minimum range"]
    assert "p5 " not in rows["Formation error"]
    assert "unfinished: 1 run missing" in result.out
    assert "Unfinished campaign" in (copy / "report.html").read_text()


def test_a_campaign_of_which_nothing_is_done_yet_has_a_report_that_says_so(
    call: Call, finished: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "begun"
    copy.mkdir()
    for name in ("campaign.json", "scenario.toml"):
        shutil.copy(finished / name, copy / name)
    result = call("report", copy, "--json")
    assert (result.status, result.json["runs"]["missing"]) == (0, 3)


def test_progress_goes_to_stderr_and_json_keeps_it_silent(call: Call, tmp_path: Path) -> None:
    words = ("campaign", "inspection", "--runs", 1, *SHORT, *SINGLY, "--no-report")
    loud = call(*words, "--out", tmp_path / "loud")
    begun, simulating, simulated, last = loud.err.splitlines()
    assert begun.startswith("rpojax: compiling (")
    assert simulating == "rpojax: simulating, 0/1 run"
    assert re.fullmatch(r"rpojax: simulating, 1/1 run in [0-9.]+ s, 0 failed, [0-9,]+ run-s/s", simulated)
    assert last == "rpojax: free drifts and metrics of the last runs"
    silent = call(*words, "--out", tmp_path / "silent", "--json")
    assert silent.err == ""
    assert silent.json["report"] is None
    assert silent.json["directory"] == str(tmp_path / "silent")
    assert not (tmp_path / "silent" / "report.html").exists()


def test_force_replaces_a_campaign(call: Call, tmp_path: Path) -> None:
    words = (
        "campaign",
        "inspection",
        "--runs",
        1,
        *SHORT,
        *SINGLY,
        "--no-report",
        "--json",
        "--out",
        tmp_path / "runs",
    )
    assert call(*words).status == 0
    again = call(*words, "--seed", 5, "--force")
    assert again.status == 0
    assert again.json["provenance"]["seed"] == 5


def test_an_interrupt_keeps_finished_blocks_and_resume_does_the_rest(
    call: Call, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "broken off"
    write = atomic_files.write_json

    def interrupt(path: Path, content: Any) -> None:
        if path.name == "000001.json":
            raise KeyboardInterrupt
        write(path, content)

    words = ("campaign", "inspection", "--runs", 3, "--histories", "0,2", *SHORT, *SINGLY, "--out", out, "--json")
    with monkeypatch.context() as patch:
        patch.setattr(atomic_files, "write_json", interrupt)
        result = call(*words)
    assert result.status == 130
    assert result.json["error"].startswith("interrupted; 1 of 3 blocks are kept")
    assert f"1 of 3 blocks are kept; go on with: rpojax resume '{out}'" in result.err
    assert not (out / "report.html").exists()

    resumed = call("resume", out, "--json")
    assert resumed.status == 0
    assert (out / "report.html").is_file()
    whole, mended = Campaign(finished), Campaign(out)
    assert resumed.json["metrics"] == json.loads((finished / "report.json").read_text())["metrics"]
    for group in ("metrics", "traces", "drawn", "used"):
        for name, values in getattr(whole, group).items():
            np.testing.assert_array_equal(getattr(mended, group)[name], values, err_msg=name)


def test_a_run_flown_again_is_compared_with_what_was_recorded(call: Call, finished: Path, tmp_path: Path) -> None:
    result = call("rerun", finished, "--run-id", 1, "--out", tmp_path / "again", "--json")
    assert result.status == 0
    assert result.json["rerun"] == {"recorded": True, "different": []}
    alone, whole = Campaign(tmp_path / "again"), Campaign(finished)
    assert (alone.run_ids.tolist(), alone.history_ids, alone.info["block_size"]) == ([1], [1], 1)
    assert alone.info["rerun_of"] == {"first_run": 0, "runs": 3}
    for name, values in whole.metrics.items():
        np.testing.assert_array_equal(alone.metrics[name], values[1:2], err_msg=name)
    assert (tmp_path / "again" / "figures" / "estimation_error.png").is_file()

    # Another seed's runs are not those that were recorded.
    copy = Path(shutil.copytree(finished, tmp_path / "copy"))
    rewrite_campaign(copy, seed=5)
    other = call("rerun", copy, "--run-id", 1, "--out", tmp_path / "other", "--no-film")
    assert "metrics are not those of the campaign, such as " in other.err
    assert call("rerun", finished, "--run-id", 3, "--out", tmp_path / "none").status == 2


def test_shards_share_a_folder_and_the_last_one_writes_the_report_of_what_one_process_gives(
    call: Call, finished: Path, tmp_path: Path
) -> None:
    out = tmp_path / "shared"
    words = ("campaign", "inspection", "--runs", 3, *SHORT, *SINGLY, "--out", out, "--json")
    chosen = ("--histories", "1+worst:1:min_range_m", "--history-channels", "range_m,nees", "--history-every", 10)
    first = call(*words, *chosen, "--shard", "2/2")
    assert (first.status, first.json["report"], first.json["runs"]["missing"]) == (0, None, 2)
    assert call("status", out, "--json").json["blocks"] == {"total": 3, "done": 1, "missing": 2}
    assert "found seed 0, expected 1" in call(*words, *chosen, "--shard", "1/2", "--seed", 1).err
    second = call(*words, *chosen, "--shard", "1/2")
    assert (second.status, second.json["report"]) == (0, str(out / "report.html"))
    whole, shared = Campaign(finished), Campaign(out)
    for name, values in whole.metrics.items():
        np.testing.assert_array_equal(shared.metrics[name], values, err_msg=name)
    # The history of the run that came nearest is that of the campaign, thinned.
    nearest = int(np.argmin(whole.metrics["min_range_m"]))
    assert shared.history_ids == sorted({0, nearest})
    for run in set(shared.history_ids) & set(whole.history_ids):
        kept = shared.history(run)
        assert kept.keys() == {"time_s", "rho_desired_H", "range_m", "nees"}
        np.testing.assert_array_equal(kept["range_m"], whole.history(run)["range_m"][::10])
    assert "estimation_error.png is omitted" in (out / "report.html").read_text()
    before = contents(out)
    assert call("resume", out, "--shard", "1/2", "--json").status == 0
    assert contents(out) == before


def test_a_full_disk_is_status_4_with_what_is_kept_and_how_to_go_on(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "runs"
    write = atomic_files.write

    def full(path: Path, content: bytes, sync: bool = False) -> None:
        if path.parts[-3:] == ("formation_error_rms_m", "c", "1"):
            raise atomic_files.write_error(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
        write(path, content, sync)

    words = ("campaign", "inspection", "--runs", 3, *SHORT, *SINGLY, "--out", out, "--json", "--no-report")
    with monkeypatch.context() as patch:
        patch.setattr(atomic_files, "write", full)
        result = call(*words)
    assert (result.status, list(result.json), result.err.count("\n")) == (4, ["error"], 1)
    assert "found no space left on device, expected room for the results" in result.err
    assert f"1 of 3 blocks are kept; go on with: rpojax resume {out}" in result.err
    assert call("resume", out, "--json").status == 0


def test_blocks_that_are_given_up_are_status_4_with_why(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        process_executor.ProcessExecutor,
        "run_blocks",
        lambda self, blocks, on_progress: {1: "the worker ended with signal 9"},
    )
    out = tmp_path / "runs"
    words = ("--runs", 3, *SHORT, *SINGLY, "--no-report", "--json", "--workers", 2)
    result = call("campaign", "inspection", *words, "--out", out)
    assert (result.status, result.json["runs"]["missing"]) == (4, 3)
    assert "found 1 blocks given up, expected none; block 1: the worker ended with signal 9" in result.err
    assert f"0 of 3 blocks are kept; go on with: rpojax resume {out}" in result.err


def test_an_interrupt_before_anything_is_written_says_so(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("rpojax.campaign.run_and_resume.start_campaign", interrupt)
    result = call("campaign", "inspection", "--runs", 3, "--out", tmp_path / "runs")
    assert (result.status, result.out) == (130, "")
    assert result.err.splitlines()[-1] == "rpojax: interrupted; nothing was written"


def test_failed_runs_are_reported_with_status_3_while_the_others_complete(call: Call, tmp_path: Path) -> None:
    out = tmp_path / "runs"
    dispersions = scenario_loader.load("inspection").model_dump()["dispersions"]
    for entry in dispersions:
        if entry["key"] == "initial.relative_velocity_m_s":
            entry.pop("sigma")
            entry |= {"kind": "choice", "values": [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]}
    tables = ", ".join(
        "{" + ", ".join(f"{k} = {json.dumps(v)}" for k, v in entry.items()) + "}" for entry in dispersions
    )
    words = (
        "campaign",
        "inspection",
        "--runs",
        4,
        *SHORT,
        f"dispersions=[{tables}]",
        *SINGLY,
        "--seed",
        3,
        "--out",
        out,
    )
    result = call(*words)
    assert result.status == 3
    found = Campaign(out)
    approaching = found.drawn["initial.relative_velocity_m_s"][:, 1] > 0.0
    assert 0 < approaching.sum() < 4
    np.testing.assert_array_equal(found.failed, approaching)
    assert f"0 completed, {approaching.sum()} failed, {4 - approaching.sum()} not judged" in result.out
    assert f"{approaching.sum()} x entered the keep-out sphere" in result.out

    report = call("report", out, "--json")
    assert report.status == 0
    failures = report.json["failures"]
    assert [entry["run_id"] for entry in failures] == np.flatnonzero(approaching).tolist()
    assert all(60.0 < entry["at_s"] < 120.0 for entry in failures)
    again = call("resume", out, "--json")
    assert (again.status, again.json["runs"]["failed"]) == (0, approaching.sum())
    assert call("status", out, "--json").json["reasons"] == {"entered the keep-out sphere": approaching.sum()}
    assert f"failed: {approaching.sum()} x entered the keep-out sphere" in call("status", out).out


def test_validate_says_what_a_scenario_holds(call: Call) -> None:
    result = call("validate", "inspection", "--set", "duration_s=120", "camera.width_px=64", "--json")
    assert result.status == 0
    assert result.json["duration_s"] == 120.0
    assert "servicer.mass_kg" in result.json["dispersions"]
    people = call("validate", "inspection")
    assert people.out == f"inspection: valid; 6000 s, {len(result.json['dispersions'])} dispersions\n"


def test_schema_describes_every_section(call: Call) -> None:
    result = call("schema")
    assert result.status == 0
    assert set(result.json["properties"]) == set(ScenarioFile.model_fields)
    assert result.json["additionalProperties"] is False


def test_bench_states_speed_and_time_to_compile(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jax, "clear_caches", lambda: None)  # other tests keep what they have compiled
    words = ("bench", "--only", "loop", "--runs", 1, "--duration-s", 400)
    result = call(*words, "--json")
    assert result.status == 0
    assert result.json["run_seconds_per_s"] > 0.0
    assert (result.json["batch"], result.json["devices"]) == (1, 1)
    assert {"compile_s", "loop_compile_s", "compile_cached_s", "machine", "versions", "batches"} <= set(result.json)
    assert not {"kernels", "vision"} & set(result.json)
    people = call(*words)
    assert "runs of" in people.out
    assert "peak memory" in people.out


def test_bench_takes_a_duration_that_the_scenario_accepts() -> None:
    assert bench._load_for(BenchCommand(scenario="inspection"), None).duration_s == 800.0
    longer = bench._load_for(BenchCommand(scenario="vbar_approach"), None).duration_s
    assert 800.0 < longer < scenario_loader.load("vbar_approach").duration_s
    assert np.log2(longer / 800.0) % 1.0 == 0.0
    with pytest.raises(RpojaxError, match=r"^duration_s: found 800, expected one that the scenario accepts, such as"):
        bench._load_for(BenchCommand(scenario="vbar_approach", duration_s=800.0), None)


def test_bench_prints_a_table_for_every_part(capsys: pytest.CaptureFixture[str]) -> None:
    times = {"batch": 4, "devices": 2, "compile_s": 1.0, "run_s": 2.0, "cpu_s": 3.0}
    loop = {
        **times,
        "loop_compile_s": 0.8,
        "compile_cached_s": 0.5,
        "run_seconds_per_s": 4321.0,
        "runs_per_hour": 5185.0,
    }
    vision = {f"{verb}_{what}": 1.0 for verb in ("render", "detect") for what in ("compile_s", "s", "cpu_s")}
    rates = {"frames_per_s": 77.0, "detections_per_s": 99.0}
    bench.show(
        {
            "batches": [loop],
            "scenario": "inspection",
            "duration_s": 200.0,
            "block_size": 256,
            "recommended_block_size": 1024,
            "kernels": {
                "orbit": {**times, "vehicles": 2048, "vehicle_steps_per_s": 98.7e6},
                "filter": {"batches": [{**times, "us_per_update": 1.23}]},
            },
            "vision": {**times, **vision, "side_px": 128, "range_m": 30.0, **rates},
            "peak_memory_mib": 1234.0,
            "machine": "a machine",
        }
    )
    out = capsys.readouterr().out
    for text in ("4,321", "5,185", "(0.8)", "[s]", "98.7 M", "1.23 us", "77", "99", "--block-size 1024", "1,234 MiB"):
        assert text in out
    assert "a machine" in out


def test_version_and_help(call: Call) -> None:
    assert call("--version").out == f"rpojax {rpojax.__version__}\n"
    top = call("--help")
    assert top.status == 0
    for verb in ("run", "campaign", "resume", "status", "rerun", "report", "film", "validate", "schema", "bench"):
        assert verb in top.out
        assert call(verb, "--help").status == 0
    for status in ("0 done", "1 unexpected", "2 bad input", "3 the campaign", "4 the campaign", "130 interrupted"):
        assert status in top.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--set", "a=1", "b=2", "inspection"], ["--set", "a=1", "--set", "b=2", "inspection"]),
        (
            ["inspection", "--set", "a=1", "--set", "b=2", "--json"],
            ["inspection", "--set", "a=1", "--set", "b=2", "--json"],
        ),
        (["--set", "bad", "inspection"], ["--set", "bad", "inspection"]),
        (["--set", "a=1", "--out", "x=1"], ["--set", "a=1", "--out", "x=1"]),
        (["inspection", "--set"], ["inspection", "--set"]),
    ],
)
def test_several_values_may_follow_one_set(words: list[str], expected: list[str]) -> None:
    assert main._repeat_set_flag(words) == expected


# Bad input

BAD_SCENARIO = [
    (["servicer.mas_kg=30"], "servicer.mas_kg", "did you mean 'servicer.mass_kg'"),
    (["servicer.mass_kg=-1"], "servicer.mass_kg", "greater than 0"),
    (["servicer.mass_kg=nan"], "servicer.mass_kg", "finite"),
    (["servicer.mass_kg=heavy"], "servicer.mass_kg", "number"),
    (["servicer.inertia_kg_m2=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]"], "servicer.inertia_kg_m2", "positive definite"),
    (["target.attitude=[0, 0, 0, 0]"], "target.attitude", "not zero"),
    (["rates.plant_hz=2.5", "rates.camera_hz=1"], "rates.plant_hz", "whole multiple of rates.camera_hz"),
    (["duration_s=400.5"], "duration_s", "whole number of camera periods"),
    (["dispersions=[{key='servicer.mas_kg', kind='normal', sigma=1}]"], "dispersions.0.key", "servicer.mass_kg"),
    (["dispersions=[{key='servicer.mass_kg', kind='gaussian', sigma=1}]"], "dispersions.0", "normal"),
    (["duration_s"], "--set", "KEY=VALUE"),
]


@pytest.fixture
def refused(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs a command line that must be refused in one line, with nothing compiled and nothing written."""
    before = contents(tmp_path)

    def compile_nothing(engine: BatchEngine) -> None:
        pytest.fail("compiled before the input was checked")

    monkeypatch.setattr(BatchEngine, "compile", compile_nothing)
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> Outcome:
        result = call(*words)
        assert (result.status, result.out) == (2, "")
        assert result.err.startswith("rpojax: error: ")
        assert result.err.count("\n") == 1
        assert "found" in result.err
        assert "expected" in result.err or "no campaign" in result.err
        assert contents(tmp_path) == before
        assert not (tmp_path / "runs").exists()
        return result

    return run


@pytest.mark.parametrize(("overrides", "key", "expected"), BAD_SCENARIO)
@pytest.mark.parametrize("verb", ["validate", "run", "campaign"])
def test_a_scenario_that_is_not_acceptable_is_refused_by_key(
    refused: Call, verb: str, overrides: list[str], key: str, expected: str
) -> None:
    rest = {"validate": [], "run": ["--out", "runs"], "campaign": ["--runs", 3, "--out", "runs"]}[verb]
    result = refused(verb, "inspection", *rest, "--set", *overrides)
    assert key in result.err
    assert expected in result.err


@pytest.mark.parametrize("text", [None, "name = ", 'name = "only a name"', 'extends = "nowhere"', "\x00\xff"])
def test_a_file_that_is_no_scenario_is_refused(call: Call, tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "mine.toml"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    result = call("run", path, "--out", tmp_path / "runs")
    assert (result.status, result.out, result.err.count("\n")) == (2, "", 1)
    assert not (tmp_path / "runs").exists()


def test_an_unknown_scenario_is_refused_with_the_names_there_are(refused: Call) -> None:
    assert "inspection" in refused("campaign", "inspektion", "--runs", 3, "--out", "runs").err


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("--runs", 0), "--runs"),
        (("--runs", 3, "--block-size", 0), "--block-size"),
        (("--runs", 3, "--block-size", -2), "--block-size"),
        (("--runs", 3, "--seed", -1), "--seed"),
        (("--runs", 3, "--histories", "0,3"), "--histories"),
        (("--runs", 3, "--histories", "some"), "--histories"),
        (("--runs", 3, "--histories", "-1,"), "--histories"),
        (("--runs", 3, "--histories", "worst:1:range"), "--histories"),
        (("--runs", 3, "--history-every", 0), "--history-every"),
        (("--runs", 3, "--shard", "3/2"), "--shard"),
        (("--runs", 3, "--shard", "1/2", "--force"), "--force"),
        (("--runs", 3, "--workers", 0), "--workers"),
        (("--runs", 3, "--executor", "ray"), "--executor"),
        (("--runs", 3, "--executor", "dask"), "--scheduler"),
        (("--runs", 3, "--scheduler", "tcp://x:1"), "--scheduler"),
        (("--runs", 3, "--set", "duration_s=1e9"), "duration_s"),
        (("--runs", 2000000000), "disk"),
        (("--runs", 100000000, "--block-size", 50000000), "memory"),
    ],
)
def test_a_campaign_that_is_not_acceptable_is_refused(refused: Call, words: tuple[Any, ...], option: str) -> None:
    assert option in refused("campaign", "inspection", *words, "--out", "runs").err


@pytest.mark.parametrize(
    ("words", "option"),
    [(("--run-id", -1), "--run-id"), (("--seed", -1), "--seed"), (("--block-size", 0), "--block-size")],
)
def test_a_run_that_is_not_acceptable_is_refused(refused: Call, words: tuple[Any, ...], option: str) -> None:
    assert option in refused("run", "inspection", *words, "--out", "runs").err


def test_output_is_refused_where_something_is_or_nothing_can_be(call: Call, refused: Call, tmp_path: Path) -> None:
    for out in (".", "/dev/null/runs", "/dev/null"):
        assert "--out" in refused("run", "inspection", "--out", out).err
    assert "no campaign" in refused("run", "inspection", "--out", ".", "--force").err


def test_output_is_refused_in_a_folder_that_cannot_be_written_to(
    refused: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The system is asked, and says no: root could write to a folder of any mode.
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    assert "can be written to" in refused("run", "inspection", "--out", "runs").err


@pytest.mark.parametrize("verb", ["resume", "report", "status"])
def test_a_folder_that_is_no_campaign_is_refused(refused: Call, verb: str) -> None:
    assert "expected a campaign folder" in refused(verb, ".").err


def spoil_manifest(folder: Path) -> None:
    (folder / "manifest" / "000001.json").write_text("{")


def lose_results(folder: Path) -> None:
    shutil.rmtree(folder / "results.zarr")


def garble_chunk(folder: Path) -> None:
    next((folder / "results.zarr" / "metrics").rglob("c/0")).write_bytes(b"garbage")


def garble_history(folder: Path) -> None:
    for path in (folder / "results.zarr" / "histories").rglob("c/**/0"):
        if path.is_file():
            path.write_bytes(b"garbage")


def lose_entry(folder: Path) -> None:
    info = json.loads((folder / "campaign.json").read_text())
    del info["runs"]
    (folder / "campaign.json").write_text(json.dumps(info))


def spoil_scenario(folder: Path) -> None:
    info = json.loads((folder / "campaign.json").read_text())
    info["scenario"]["servicer"]["mass_kg"] = -1.0
    (folder / "campaign.json").write_text(json.dumps(info))


def put_folder_for_page(folder: Path) -> None:
    (folder / "report.html").unlink()
    (folder / "report.html").mkdir()


def put_file_for_figures(folder: Path) -> None:
    shutil.rmtree(folder / "figures")
    (folder / "figures").write_text("")


SPOILT = (
    *(spoil_manifest, lose_results, garble_chunk, garble_history, lose_entry, spoil_scenario),
    *(put_folder_for_page, put_file_for_figures),
)


def test_a_spoilt_folder_is_refused_in_one_line(finished: Path, tmp_path: Path) -> None:
    folders = [shutil.copytree(finished, tmp_path / spoil.__name__) for spoil in SPOILT]
    for spoil, folder in zip(SPOILT, folders, strict=True):
        spoil(folder)
    # In a process without the run-time checks of shapes and types, which look at every property of a campaign first.
    code = (
        "import sys; from rpojax.cli.main import main; "
        "print([int(main(['report', f, '--json'])) for f in sys.argv[1:]])"
    )
    result = python("-c", code, *folders)
    *errors, statuses = result.stdout.splitlines()
    assert statuses == str([2] * len(SPOILT)), result.stderr
    assert [list(json.loads(error)) for error in errors] == [["error"]] * len(SPOILT)
    lines = result.stderr.splitlines()
    assert len(lines) == len(SPOILT)
    for line in lines:
        assert re.match("rpojax: error: .*(found|missing).*expected ", line)


def test_a_run_without_history_cannot_be_shown(refused: Call, finished: Path) -> None:
    before = contents(finished)
    assert "expected one of: 0, 2" in refused("report", finished, "--run-id", 1).err
    assert contents(finished) == before


def test_batches_that_make_no_sense_are_refused(refused: Call) -> None:
    assert "--runs" in refused("bench", "--runs", 0).err
    assert "duration_s" in refused("bench", "--duration-s", "nan").err
    assert "--only" in refused("bench", "--only", "loop,kernel").err
    assert "--only: found 'vision' with a scenario" in refused("bench", "--only", "vision", "--set", "orbit.e=0.1").err


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("fly",),
        ("run", "inspection"),
        ("campaign", "inspection", "--out", "runs"),
        ("campaign", "inspection", "--runs", "five", "--out", "runs"),
        ("run", "inspection", "--out", "runs", "--sett", "a=1"),
    ],
)
def test_wrong_usage_is_status_2_too(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: Any) -> None:
    monkeypatch.chdir(tmp_path)
    result = call(*words)
    assert (result.status, result.out) == (2, "")
    assert result.err
    assert list(tmp_path.iterdir()) == []


# What is imported and set when


def python(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """A fresh Python process."""
    path = {"PYTHONPATH": str(Path(rpojax.__file__).parents[1])}
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, env=os.environ | path | environment, capture_output=True, text=True, check=False)


WITHOUT_JAX = """
import sys
from rpojax.cli.main import main
for words in (["--help"], ["campaign", "--help"], ["--version"], ["--tyro-print-completion", "bash"]):
    try:
        main(words)
    except SystemExit:
        pass
print("loaded:", *{"jax", "zarr", "plotly", "matplotlib", "scipy.stats"} & set(sys.modules))
"""


def test_help_and_completion_load_nothing_heavy() -> None:
    result = python("-c", WITHOUT_JAX)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "loaded:"


def test_help_does_not_even_load_numpy() -> None:
    code = "import sys, rpojax.cli.main\ntry: rpojax.cli.main.main(['--help'])\nfinally: print('numpy' in sys.modules)"
    assert python("-c", code).stdout.splitlines()[-1] == "False"


def test_the_package_runs_as_a_module() -> None:
    result = python("-m", "rpojax", "validate", "inspection", "--set", "servicer.mass_kg=0")
    assert result.returncode == 2
    assert result.stderr.startswith("rpojax: error: servicer.mass_kg")


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    path = {"PYTHONPATH": str(Path(rpojax.__file__).parents[1])}
    command = [sys.executable, "-m", "rpojax", "schema"]
    with subprocess.Popen(
        command, env=os.environ | path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, str]:
    """Environment of a process that has not imported jax yet."""
    variables = {"HOME": str(tmp_path)}
    monkeypatch.delitem(sys.modules, "jax")
    monkeypatch.setattr(jax_environment, "_has_begun", lambda: False)
    monkeypatch.setattr(os, "environ", variables)
    return variables


def test_jax_gets_a_device_per_core_and_a_cache(
    environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jax_environment, "available_cores", lambda: 3)
    environment["XLA_FLAGS"] = "--xla_dump_to=x"
    jax_environment.prepare_jax(cache=True)
    assert environment["XLA_FLAGS"] == "--xla_dump_to=x --xla_force_host_platform_device_count=3"
    assert environment["JAX_COMPILATION_CACHE_DIR"] == str(tmp_path / ".cache" / "rpojax" / "jax")
    assert environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] == "0"
    assert environment["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] == "-1"
    assert (tmp_path / ".cache" / "rpojax" / "jax").is_dir()


def test_what_the_user_set_for_jax_stays(environment: dict[str, str], tmp_path: Path) -> None:
    flags = "--xla_force_host_platform_device_count=7"
    environment |= {"XLA_FLAGS": flags, "JAX_COMPILATION_CACHE_DIR": "mine", "XDG_CACHE_HOME": str(tmp_path / "xdg")}
    jax_environment.prepare_jax(cache=True)
    assert environment["XLA_FLAGS"] == flags
    assert environment["JAX_COMPILATION_CACHE_DIR"] == "mine"


@pytest.mark.parametrize("switch", ["argument", "variable", "unwritable"])
def test_the_cache_can_be_off_and_need_not_be_there(environment: dict[str, str], tmp_path: Path, switch: str) -> None:
    if switch == "variable":
        environment["RPOJAX_CACHE"] = "off"
    if switch == "unwritable":
        (tmp_path / ".cache").write_text("a file where a folder should be")
    jax_environment.prepare_jax(cache=switch != "argument")
    assert "JAX_COMPILATION_CACHE_DIR" not in environment


def test_a_plugin_may_import_jax_after_it_is_prepared(environment: dict[str, str]) -> None:
    with forgotten_plugins():
        work = main._work(RunCommand(scenario="mine.toml", out=Path("out")), ["--allow-plugin", "--no-cache"], True)
        assert plugin_registry.is_permitted()
    assert work is run_and_campaign.run
    assert "--xla_force_host_platform_device_count" in environment["XLA_FLAGS"]
    assert environment["TF_CPP_MIN_LOG_LEVEL"] == "3"
    assert "JAX_COMPILATION_CACHE_DIR" not in environment


def test_nothing_is_set_once_jax_has_begun(environment: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jax_environment, "_has_begun", lambda: True)
    before = dict(environment)
    jax_environment.prepare_jax(cache=True)
    assert environment == before


# Signals


def start(*words: object) -> subprocess.Popen[str]:
    """A verb in its own process, on one device."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=1"
    path = {"PYTHONPATH": str(Path(rpojax.__file__).parents[1]), "XLA_FLAGS": flags}
    return subprocess.Popen(
        [sys.executable, "-m", "rpojax", *map(str, words)],
        env=os.environ | path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    while not path.exists():
        assert process.poll() is None
        time.sleep(0.02)


@pytest.mark.slow
def test_ctrl_c_while_compiling_ends_at_once_and_names_resume(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    process = start("campaign", "inspection", *LONG, "--no-cache", "--out", out)
    wait_for(out / "campaign.json", process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=5.0)
    assert process.returncode == 130
    assert f"0 of 40 blocks are kept; go on with: rpojax resume {out}" in err


@pytest.mark.slow
def test_a_killed_campaign_resumes_to_what_an_uninterrupted_one_gives(tmp_path: Path) -> None:
    out, whole = tmp_path / "runs", tmp_path / "whole"
    process = start("campaign", "inspection", *LONG, "--out", out)
    wait_for(out / "manifest" / "000002.json", process)
    process.kill()
    process.communicate()
    assert 0 < len(Campaign(out).missing_blocks()) < 40
    for words in (["resume", out], ["campaign", "inspection", *LONG, "--out", whole]):
        another = start(*words)
        another.communicate()
        assert another.returncode == 0
    expected, found = Campaign(whole), Campaign(out)
    assert found.missing_blocks() == []
    for group in ("metrics", "traces", "drawn", "used"):
        for name, values in getattr(expected, group).items():
            np.testing.assert_array_equal(getattr(found, group)[name], values, err_msg=name)
