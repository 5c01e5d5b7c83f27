"""The command `rpojax calibrate-camera-model`: fits the statistical camera to the rendered one."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rpojax.cli.arguments import AsJson, Overrides, Source
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import items, stage

if TYPE_CHECKING:
    from rpojax.analysis.calibration.camera_fit import CameraFit
    from rpojax.scenario.schema import ScenarioFile
    from rpojax.sensors.statistical_camera import CameraStatistics

_NOT_PRINTED = ("fitted_for", "made_with", "limits")


def calibrate_camera_model(
    scenario: Source,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as target.camera.safetensors.")],
    samples: Annotated[int, arg(metavar="N", help="Rendered views for the fit.")] = 16000,
    sequences: Annotated[
        int, arg(metavar="N", help="Sequences of tumbling targets for the correlation time of errors.")
    ] = 200,
    seed: Annotated[int, arg(metavar="S", help="Seed of the views and of the fit.")] = 0,
    overrides: Overrides = (),
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Fit the statistical camera to renderer and detector, for the camera and target of a scenario."""
    if samples < 200 or sequences < 4:
        raise RpojaxError.of_argument(
            "samples, sequences", f"found {samples}, {sequences}, expected at least 200 and 4"
        )
    claim(out, force)
    from rpojax.scenario.checks import target_checks
    from rpojax.scenario.loading import scenario_loader as scenarios

    file = scenarios.load(scenario, overrides)
    target_checks.check_field(file)
    from rpojax.analysis.calibration import detection_outcomes
    from rpojax.scenario.plugins.command_lines import command_line
    from rpojax.scenario.trained import fitted_camera
    from rpojax.sensors import statistical_camera_file

    fit, statistics, outcomes = _fit(file, samples, sequences, seed, as_json)
    set_keys = [word for override in overrides for word in ("--set", override)]
    numbers = ("--samples", samples, "--sequences", sequences, "--seed", seed)
    words = (Path(scenario).name, *set_keys, "--out", out.name, *numbers)
    tables = file.model_dump()
    card = {
        "scenario": file.name,
        "samples": samples,
        "sequences": sequences,
        "seed": seed,
        **outcomes,
        "lasting_share": float(statistics.lasting_share),
        "lasting_angle_deg": math.degrees(float(statistics.lasting_angle)),
        "log_likelihood": fit.log_likelihood,
        "log_likelihood_held_out": fit.log_likelihood_held_out,
        "command": command_line("calibrate-camera-model", *words, plugin=file.plugin),
        "fitted_for": fitted_camera.fitted_for(tables),
        "made_with": fitted_camera.made_with(tables),
        "limits": detection_outcomes.view_limits(file),
    }
    statistical_camera_file.save_statistics(statistics, out, card)
    shown = {"file": str(out), **{name: value for name, value in card.items() if name not in _NOT_PRINTED}}
    if as_json:
        print_json(shown)
    else:
        print("\n".join(f"{name}: {value}" for name, value in shown.items()))
    return 0


def _fit(
    file: "ScenarioFile", samples: int, sequences: int, seed: int, quiet: bool
) -> "tuple[CameraFit, CameraStatistics, dict[str, Any]]":
    """Fit to rendered views, its camera with the correlation of errors, and a summary of the detector's outcomes."""
    from rpojax.analysis.calibration import camera_fit, detection_outcomes

    with items("rendering", quiet=quiet) as watch:
        found = detection_outcomes.detect_in_views(
            file, detection_outcomes.sample_views(file, samples, seed), seed, watch
        )
    threshold = file.imaging.score_threshold
    with items("rendering sequences", quiet=quiet) as watch:
        turning = camera_fit.sample_tumble_sequences(file, sequences, seed + 1)
        seen = detection_outcomes.detect_in_views(file, turning.views, seed + 1, watch)
    with stage("fitting", quiet=quiet):
        fit = camera_fit.fit_camera(found, threshold, seed)
        statistics = camera_fit.with_error_correlation(fit.statistics, seen, turning.turn_per_frame, threshold)
    return fit, statistics, camera_fit.outcome_summary(found, threshold)
