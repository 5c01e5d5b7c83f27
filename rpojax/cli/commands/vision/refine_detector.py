"""The command `rpojax detector refine`: detector and filter noises refined together in the closed loop, and judged."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.analysis.gradients import detector_refinement
from rpojax.analysis.gradients.detector_refinement import MAP_LOSS, Refined, RefinementSettings, UnseenRuns
from rpojax.analysis.gradients.tuning import tuned_file
from rpojax.analysis.gradients.tuning.tune import tuned_scenario
from rpojax.campaign.storage.atomic_outputs import to_json_types, write_atomically, write_json
from rpojax.cli.options.vision import RefineDetectorCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.scenario_files import load
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.progress import items
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import trained_files
from rpojax.training.detector import evaluate_detector
from rpojax.training.synthetic_data import detection_dataset
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.detector_file import load_detector, save_detector
from rpojax.vision.detector.two_stage_detector import DetectorParams

_VALIDATION = "validation"


def refine(asked: RefineDetectorCommand) -> int:
    """Does the work of the command; returns its exit status."""
    scenario, report = asked.out.with_suffix(".toml"), asked.out.with_suffix(".json")
    for path, suffix in ((asked.out, ".safetensors"), (scenario, ".toml"), (report, ".json")):
        claim(path, asked.force, (suffix,))
    names = (field.name for field in dataclasses.fields(RefinementSettings))
    settings = RefinementSettings(**{name: getattr(asked, name) for name in names})
    file = load(asked.scenario, asked.overrides)
    detector_refinement.check(file)
    datasets = {str(folder): _unseen_pictures(folder) for folder in asked.data}

    with items("refining", quiet=asked.as_json) as watch:
        found = detector_refinement.refine(file, settings, lambda number, words: watch(number, settings.steps, words))
    start, card = load_detector(trained_files.file_path(file.model_dump(), "detector"))
    precision = {name: _precisions(start, found.detector, data) for name, data in datasets.items()}
    candidate = asked.out.with_name(asked.out.stem + ".candidate.safetensors")
    save_detector(found.detector, candidate, card)
    refined = _refined_scenario(file, found, candidate)
    try:
        with items("unseen runs", quiet=asked.as_json) as watch:
            unseen = detector_refinement.judge(
                file, refined, settings, lambda fraction: watch(round(100 * fraction), 100, "")
            )
    finally:
        candidate.unlink(missing_ok=True)
    content = _content(file, found, unseen, precision, settings)
    words = (Path(asked.scenario).name, *(word for each in asked.overrides for word in ("--set", each)))
    made_by = command_line("detector refine", *words, "--seed", asked.seed, plugin=file.plugin)
    record = {"command": made_by, "before": card.get("command"), "refined": content}
    save_detector(found.detector if content["kept"] else start, asked.out, {**card, **record})
    if content["kept"]:
        _write_scenario(_refined_scenario(file, found, asked.out), asked.scenario, scenario)
        content["scenario"] = str(scenario)
    write_json(report, content)
    _print_result({"weights": str(asked.out), **content}, asked.as_json)
    return 0


def _unseen_pictures(folder: Path) -> DetectionDataset:
    """Pictures of a data set on which no detector was trained."""
    return detection_dataset.read_dataset(folder / _VALIDATION if (folder / _VALIDATION).is_dir() else folder)


def _precisions(start: DetectorParams, refined: DetectorParams, data: DetectionDataset) -> dict[str, list[float]]:
    """Average precisions before and after."""
    both = [
        evaluate_detector.detection_metrics(evaluate_detector.detect_images(params, data.images), data)
        for params in (start, refined)
    ]
    return {name: [figures[name] for figures in both] for name in ("map50", "map50_95", "recall")}


def _refined_scenario(file: ScenarioFile, found: Refined, weights: Path) -> ScenarioFile:
    return tuned_scenario(file, {**found.values, "imaging.detector": str(weights)})


def _content(
    file: ScenarioFile,
    found: Refined,
    unseen: UnseenRuns,
    precision: Mapping[str, Mapping[str, list[float]]],
    settings: RefinementSettings,
) -> dict[str, Any]:
    """Content of the JSON file."""
    lost = {
        name: round(figures[metric][0] - figures[metric][1], 4)
        for name, figures in precision.items()
        for metric in ("map50_95",)
    }
    forgets = [name for name, loss in lost.items() if not loss <= MAP_LOSS]
    reasons = [] if unseen.is_better else ["navigation errors of unseen runs are not smaller beyond chance"]
    reasons += [f"average precision on {name} is lower by {lost[name]:g}" for name in forgets]
    return to_json_types(
        {
            "kept": not reasons,
            "reasons": reasons,
            "unseen_runs": dataclasses.asdict(unseen),
            "average_precision": precision,
            "changes": {
                key: {"from": nominal_of_key(file, key), "to": np.asarray(value)} for key, value in found.values.items()
            },
            "objectives": found.objectives,
            "settings": dataclasses.asdict(settings),
            "compile_s": round(found.compile_s, 1),
            "steps_s": round(found.steps_s, 1),
            "memory_mb": round(found.memory_bytes / 1e6),
        }
    )


def _write_scenario(refined: ScenarioFile, source: str, path: Path) -> None:
    """Writes the scenario with refined noises and weights, as one that extends its source where it can."""
    import tomli_w

    text = tuned_file.extending_text(refined, source, path)
    write_atomically(path, (text or tomli_w.dumps(refined.model_dump(mode="json", exclude_none=True))).encode())


def _print_result(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(content)
        return
    unseen = content["unseen_runs"]
    print(f"{unseen['runs']} unseen runs, relative position error: p95 {_change(unseen['p95'])} m, ", end="")
    low, high = unseen["ratio_95"]
    print(f"mean ratio {unseen['ratio']:.3f} ({low:.3f} to {high:.3f}); failed {unseen['failed'][0]} -> ", end="")
    print(unseen["failed"][1])
    for name, figures in content["average_precision"].items():
        print(f"{name}: mAP {_change(figures['map50_95'])}, mAP50 {_change(figures['map50'])}")
    for key, change in content["changes"].items():
        print(f"{key}: {change['from']} -> {change['to']}")
    if content["kept"]:
        print(f"refined weights: {content['weights']}, with the noises in {content['scenario']}")
    else:
        print(
            f"not kept, so that {content['weights']} has the weights of the scenario: {'; '.join(content['reasons'])}"
        )


def _change(pair: list[float]) -> str:
    return f"{pair[0]:.4g} -> {pair[1]:.4g}"
