"""The command `rpojax tune`: flight software tuned by gradient, judged on runs that the tuning has never seen."""

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import UseAppendAction, arg

from rpojax.cli.arguments import AsJson, NoCache, Overrides, Seed, Source, load
from rpojax.cli.console import print_json
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim, resumable
from rpojax.errors import OutputError, RpojaxError
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag
from rpojax.runtime.progress import item_progress

if TYPE_CHECKING:
    from rpojax.analysis.gradients.gradient_descent import TuningResult, TuningSettings, TuningStep
    from rpojax.analysis.gradients.tuning_validation import Validation
    from rpojax.scenario.schema import ScenarioFile

SHOWN = (
    "nees_mean",
    "nees_relative_mean",
    "nis_box_mean",
    "nis_gps_mean",
    "nav_relative_position_error_rms_m",
    "nav_servicer_position_error_rms_m",
    "formation_error_rms_m",
    "delta_v_m_s",
    "pointing_error_p95_deg",
)
"""Metrics whose means are printed."""


def tune(
    scenario: Source,
    *,
    out: Annotated[
        Path, arg(metavar="FILE", help="Scenario file to write (.toml); a .json beside it tells the story.")
    ],
    parameters: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="NAMES",
            help="What to tune: navigation, gate, formation, attitude, schedule, or keys.",
            help_behavior_hint="(default: navigation)",
        ),
    ] = (),
    runs: Annotated[int, arg(metavar="N", help="Runs per step.")] = 64,
    steps: Annotated[int, arg(metavar="N", help="Steps.")] = 80,
    horizon: Annotated[float, arg(metavar="T", help="Simulated time of a run [s].")] = 2000.0,
    rate: Annotated[float, arg(metavar="R", help="Size of the first steps; 0.2 is about twenty per cent.")] = 0.2,
    judge: Annotated[int, arg(metavar="N", help="Unseen full runs to judge the result by; 0 for none.")] = 500,
    seed: Seed = 0,
    overrides: Overrides = (),
    resume: Annotated[bool, arg(help="Go on with an interrupted tuning.")] = False,
    force: Annotated[bool, arg(help="Replace what is there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Tune gains and filter noises by gradient, and compare the result with the start on runs never used in tuning."""
    report, progress = out.with_suffix(".json"), out.with_suffix(".progress.json")
    for path, suffix in ((out, ".toml"), (report, ".json")):
        claim(path, force, (suffix,))
    _check_progress(progress, resume, force)
    if judge < 0 or judge == 1:
        raise RpojaxError(f"--judge: found {judge}, expected 0 or at least 2")
    file = load(scenario, overrides)
    prepare_jax(cache=not no_cache)
    set_loop_fusion_flag(rendered=file.camera.model == "rendered")
    from rpojax.analysis.gradients import gradient_descent, tuning_validation

    words = gradient_descent.split_names(parameters or ("navigation",))
    settings = gradient_descent.TuningSettings(words, runs, steps, seed, horizon, rate)
    out.parent.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    with resumable(progress), item_progress("tuning", quiet=as_json) as watch:
        tuned = gradient_descent.descend(
            file, settings, progress, resume, lambda number, step: watch(number, steps, _note(step))
        )
    better = gradient_descent.tuned_scenario(file, tuned.values)
    found = None
    if judge:
        with item_progress("judging", quiet=as_json) as watch:
            found = tuning_validation.validate(
                file, better, seed + 1, judge, lambda share: watch(round(100 * share), 100)
            )
    content = story(file, settings, tuned, found, time.perf_counter() - begin)
    _write(out, report, better, content)
    progress.unlink(missing_ok=True)
    if as_json:
        print_json(content)
    else:
        _show(content, out)
    return Status.DONE


def _check_progress(progress: Path, resume: bool, force: bool) -> None:
    if resume and not progress.exists():
        raise OutputError(f"{progress}: found no tuning to resume, expected one")
    if progress.exists() and not resume and not force:
        raise OutputError(f"{progress}: a tuning is under way; --resume goes on with it, --force begins anew")


def _note(step: "TuningStep") -> str:
    return f"objective {step.objective:.4f}"


def story(
    file: "ScenarioFile", settings: "TuningSettings", tuned: "TuningResult", found: "Validation | None", total_s: float
) -> dict[str, Any]:
    """What happened, as plain numbers."""
    from rpojax.campaign.storage.json_types import to_json_types
    from rpojax.scenario import schema

    changes = {key: {"from": schema.nominal_value(file, key), "to": value} for key, value in tuned.values.items()}
    content: dict[str, Any] = {
        "scenario": file.name,
        "settings": dataclasses.asdict(settings),
        "weights": file.tuning.model_dump(),
        "changes": changes,
        "mode": tuned.mode,
        "compile_s": tuned.compile_s,
        "tuning_s": sum(step.run_s for step in tuned.steps),
        "total_s": total_s,
        "memory_mb": tuned.memory_bytes / 1e6,
        "steps": [dataclasses.asdict(step) for step in tuned.steps],
    }
    if found is not None:
        content["judged"] = {
            "seed": found.seed,
            "runs": len(found.baseline.run_ids),
            "failed": [int((~each.completed).sum()) for each in (found.baseline, found.tuned)],
            "means": {name: dataclasses.asdict(change) for name, change in found.means.items()},
            "medians": [dataclasses.asdict(change) for change in found.medians.metrics],
        }
    return to_json_types(content)


def _write(out: Path, report: Path, better: "ScenarioFile", content: dict[str, Any]) -> None:
    import tomli_w

    from rpojax.campaign.storage.output_files import write_atomically, write_json

    words = ", ".join(content["settings"]["parameters"])
    header = f"# {content['scenario']} with {words} tuned by gradient; {report.name} tells how, and how it was judged\n"
    write_json(report, content)
    write_atomically(out, (header + tomli_w.dumps(better.model_dump(mode="json", exclude_none=True))).encode())


def _show(content: dict[str, Any], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from rpojax.report.labels import format_number, metric_label

    shown = Console(highlight=False)
    for key, change in content["changes"].items():
        shown.print(f"{key}: {_rounded(change['from'])} -> {_rounded(change['to'])}", markup=False, soft_wrap=True)
    first, last = content["steps"][0], content["steps"][-1]
    times = f"{content['tuning_s']:.0f} s, compilation {content['compile_s']:.0f} s beside it"
    shown.print(f"objective {first['objective']:.4f} -> {last['objective']:.4f}; {times}, {content['mode']} mode")
    if judged := content.get("judged"):
        table = Table(title=f"{judged['runs']} unseen runs, seed {judged['seed']}: means")
        for heading in ("metric", "unit", "start", "tuned", "ratio", "95 % interval"):
            table.add_column(heading, justify="left" if heading in ("metric", "unit") else "right")
        for name in SHOWN:
            if change := judged["means"].get(name):
                label, (low, high) = metric_label(name), change["ratio_95"]
                interval = f"{format_number(low, 3)} to {format_number(high, 3)}"
                cells = (
                    format_number(change["first"]),
                    format_number(change["second"]),
                    format_number(change["ratio"], 3),
                    interval,
                )
                table.add_row(label.title, label.unit, *cells)
        shown.print(table)
        if verdict := _verdict(judged["means"]):
            shown.print(verdict)
    shown.print(f"tuned scenario: {out}")


def _verdict(means: dict[str, Any]) -> str:
    """Says so where tuning has made things worse or changed nothing that chance cannot explain."""
    names = [name for name in SHOWN if name in means and not name.startswith(("nees", "nis"))]
    better = [name for name in names if means[name]["ratio_95"][1] < 1.0]
    worse = [name for name in names if means[name]["ratio_95"][0] > 1.0]
    if not better and not worse:
        return "No error or effort differs from the start's beyond chance: this start was about as good as it gets."
    if worse:
        return f"Beyond chance, worse than the start: {', '.join(worse)}."
    return ""


def _rounded(value: Any) -> Any:
    return [_rounded(each) for each in value] if isinstance(value, list) else float(f"{value:.4g}")
