"""The command `rpojax calibrate-camera-model`: fits the statistical camera to the rendered one."""

import math
from pathlib import Path
from typing import Any

from rpojax.analysis.calibration import camera_fit, detection_outcomes, landmark_fit
from rpojax.analysis.calibration.camera_fit import CameraFit
from rpojax.cli.options.vision import CalibrateCameraModelCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import items, stage
from rpojax.scenario.checks import target_checks
from rpojax.scenario.loading import scenario_loader as scenarios
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import fitted_camera, target_landmarks
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import CameraStatistics

_NOT_PRINTED = ("fitted_for", "made_with", "limits")


def calibrate_camera_model(asked: CalibrateCameraModelCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if asked.samples < 200 or asked.sequences < 4:
        raise RpojaxError.of_argument(
            "samples, sequences", f"found {asked.samples}, {asked.sequences}, expected at least 200 and 4"
        )
    claim(asked.out, asked.force)

    file = scenarios.load(asked.scenario, asked.overrides)
    target_checks.check_field(file)

    if asked.range_m is not None and not 0.0 < asked.range_m[0] < asked.range_m[1] < math.inf:
        raise RpojaxError.of_argument("range-m", f"found {asked.range_m}, expected two increasing numbers above 0")
    fit, statistics, outcomes = _fit(file, asked)
    set_keys = [word for override in asked.overrides for word in ("--set", override)]
    numbers = ("--samples", asked.samples, "--sequences", asked.sequences, "--seed", asked.seed)
    if asked.range_m is not None:
        numbers = ("--range-m", *(f"{each:g}" for each in asked.range_m), *numbers)
    words = (Path(asked.scenario).name, *set_keys, "--out", asked.out.name, *numbers)
    tables = file.model_dump()
    card = {
        "scenario": file.name,
        "samples": asked.samples,
        "sequences": asked.sequences,
        "seed": asked.seed,
        **outcomes,
        "lasting_share": float(statistics.lasting_share),
        "lasting_angle_deg": math.degrees(float(statistics.lasting_angle)),
        "log_likelihood": fit.log_likelihood,
        "log_likelihood_held_out": fit.log_likelihood_held_out,
        "command": command_line("calibrate-camera-model", *words, plugin=file.plugin),
        "fitted_for": fitted_camera.fitted_for(tables),
        "made_with": fitted_camera.made_with(tables),
        "limits": detection_outcomes.view_limits(file, asked.range_m),
    }
    statistical_camera_file.save_statistics(statistics, asked.out, card)
    shown = {"file": str(asked.out), **{name: value for name, value in card.items() if name not in _NOT_PRINTED}}
    if asked.as_json:
        print_json(shown)
    else:
        print("\n".join(f"{name}: {value}" for name, value in shown.items()))
    return 0


def _fit(file: ScenarioFile, asked: CalibrateCameraModelCommand) -> tuple[CameraFit, CameraStatistics, dict[str, Any]]:
    """Fit to rendered views, its camera with the correlation of errors, and a summary of what the networks found."""
    seed, quiet = asked.seed, asked.as_json
    with items("rendering", quiet=quiet) as watch:
        views = detection_outcomes.sample_views(file, asked.samples, seed, asked.range_m)
        found = detection_outcomes.detect_in_views(file, views, seed, watch)
    threshold = file.imaging.score_threshold
    with items("rendering sequences", quiet=quiet) as watch:
        turning = camera_fit.sample_tumble_sequences(file, asked.sequences, seed + 1, asked.range_m)
        seen = detection_outcomes.detect_in_views(file, turning.views, seed + 1, watch)
    turn = turning.turn_per_frame
    with stage("fitting", quiet=quiet):
        fit = camera_fit.fit_camera(found, threshold, seed)
        statistics = camera_fit.with_error_correlation(fit.statistics, seen, turn, threshold)
        summary: dict[str, Any] = camera_fit.outcome_summary(found, threshold)
        landmarks = target_landmarks.landmarks_for_camera(file.model_dump())
        if landmarks is not None:
            of_network, figures = landmark_fit.fit_landmarks(found, landmarks, file.camera, threshold, seed)
            of_network = landmark_fit.with_landmark_correlation(of_network, seen, turn, threshold)
            statistics = replace(statistics, landmarks=of_network)
            lasting = {
                "lasting_share": float(of_network.lasting_share),
                "lasting_angle_deg": math.degrees(float(of_network.lasting_angle)),
            }
            summary["landmarks"] = {**figures, **lasting}
    return fit, statistics, summary
