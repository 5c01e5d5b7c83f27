"""The verb `rpojax calibrate-camera-model`."""

import json
import math
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from rpojax.cli.output_paths import claim
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import busy, item_progress

_UNTOLD = ("fitted_for", "made_with", "limits")


def calibrate_camera_model(
    scenario: Annotated[Positional[str], arg(metavar="SCENARIO", help="Packaged name, or a TOML file.")],
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as target.camera.safetensors.")],
    samples: Annotated[int, arg(metavar="N", help="Rendered views to fit to.")] = 16000,
    sequences: Annotated[int, arg(metavar="N", help="Tumbling targets that show how long errors last.")] = 200,
    seed: Annotated[int, arg(metavar="S", help="Seed of the views and of the fit.")] = 0,
    overrides: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(name="set", metavar="KEY=VALUE", help="Another value for a key of the scenario, in TOML."),
    ] = (),
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")] = False,
) -> int:
    """Fit the statistical camera to renderer and detector, for a scenario's camera and target."""
    if samples < 200 or sequences < 4:
        raise RpojaxError(f"--samples, --sequences: found {samples}, {sequences}, expected at least 200 and 4")
    claim(out, force)
    from rpojax.scenario import scenario_file as scenarios

    file = scenarios.load(scenario, overrides)
    from rpojax.analysis.calibration import camera_calibration, error_correlation
    from rpojax.scenario import trained_files
    from rpojax.sensors import statistical_camera_file

    tables = file.model_dump()
    with item_progress("rendering", quiet=as_json) as watch:
        found = camera_calibration.detect_in_views(
            file, camera_calibration.sample_views(file, samples, seed), seed, watch
        )
    threshold = file.imaging.score_threshold
    with item_progress("rendering sequences", quiet=as_json) as watch:
        turning = error_correlation.sample_tumble_sequences(file, sequences, seed + 1)
        seen = camera_calibration.detect_in_views(file, turning.views, seed + 1, watch)
    with busy("fitting", quiet=as_json):
        fit = camera_calibration.fit_camera(found, threshold, seed)
        statistics = error_correlation.with_error_correlation(fit.statistics, seen, turning.turn_per_frame, threshold)
    numbers = f"--samples {samples} --sequences {sequences} --seed {seed}"
    command = f"rpojax calibrate-camera-model {Path(scenario).name} --out {out.name} {numbers}"
    card = {
        "scenario": file.name,
        "samples": samples,
        "sequences": sequences,
        "seed": seed,
        **camera_calibration.outcome_summary(found, threshold),
        "lasting_share": float(statistics.lasting_share),
        "lasting_angle_deg": math.degrees(float(statistics.lasting_angle)),
        "log_likelihood": fit.log_likelihood,
        "log_likelihood_held_out": fit.log_likelihood_held_out,
        "command": command,
        "fitted_for": trained_files.fitted_for(tables),
        "made_with": trained_files.made_with(tables),
        "limits": camera_calibration.view_limits(file),
    }
    statistical_camera_file.save_statistics(statistics, out, card)
    shown = {"file": str(out), **{name: value for name, value in card.items() if name not in _UNTOLD}}
    print(json.dumps(shown, indent=2) if as_json else "\n".join(f"{name}: {value}" for name, value in shown.items()))
    return 0
