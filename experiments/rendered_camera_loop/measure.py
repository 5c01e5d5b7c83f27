"""The closed loop with the rendered camera: formation keeping, cost, and equivalence of the statistical camera.

python experiments/rendered_camera_loop/measure.py run [--scenario NAME] [--model rendered] [--runs 20] [--first-run 0]
python experiments/rendered_camera_loop/measure.py table DIR...
python experiments/rendered_camera_loop/measure.py equivalence RENDERED_DIR... --statistical DIR...
"""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign

OUT = Path("out/rendered_camera_loop")
METRICS = {
    "formation_error_rms_m": "formation error RMS [m]",
    "nav_relative_position_error_rms_m": "relative position error RMS [m]",
    "sigma3_coverage": "coverage",
    "detection_rate": "boxes per observable frame",
    "visible_fraction": "accepted",
    "boxes_rejected": "rejected",
    "min_range_m": "least range [m]",
}
RATIOS = ("formation_error_rms_m", "nav_relative_position_error_rms_m")
RATIO_BOUNDS = (0.75, 1.33)
RATE_BOUND = 0.03
RESAMPLES = 4000


def run(
    scenario: str, model: str, runs: int, first_run: int, duration_s: float, seed: int, block_size: int | None
) -> Path:
    """One campaign, with its cost printed."""
    from rpojax.runtime.jax_environment import prepare_jax

    prepare_jax(cache=True)
    from rpojax.campaign import run_and_resume
    from rpojax.scenario.loading import scenario_loader as scenarios

    file = scenarios.load(scenario, [f"camera.model={model}", f"duration_s={duration_s}"])
    out = OUT / (f"{scenario}_{model}_{runs}" + (f"_from_{first_run}" if first_run else ""))
    kept = range(first_run, first_run + runs)
    begin = time.perf_counter()
    result = run_and_resume.run_campaign(
        file, runs, out, seed, first_run=first_run, block_size=block_size, histories=kept, force=True
    )
    total = time.perf_counter() - begin
    timing = result.info["timing"]
    per_second = 1e3 * timing["run_s"] / (runs * duration_s)
    print(f"{out}: {total:.0f} s in all, of which compilation {timing['compile_s']:.0f} s")
    print(f"{per_second:.1f} ms per simulated second and run: {1e3 / per_second:.0f} times as fast as real time")
    return out


def open_campaign(folder: Path) -> "Campaign":
    """An existing campaign."""
    from rpojax.campaign.storage.campaign_folder import Campaign

    return Campaign(folder)


def values(campaign: "Campaign", name: str) -> np.ndarray:
    """A metric of the runs that did not fail."""
    found = np.asarray(campaign.metrics[name], dtype=float)
    return found[np.isfinite(found)]


def table(folders: list[Path]) -> None:
    """Medians and extremes of campaigns."""
    print("| campaign | runs, failed | metric | median | p5 | p95 |\n|---|---|---|---|---|---|")
    for folder in folders:
        campaign = open_campaign(folder)
        failed = int(np.count_nonzero(~campaign.completed))
        for name, title in METRICS.items():
            found = values(campaign, name)
            low, middle, high = np.percentile(found, [5, 50, 95])
            head = (
                f"| {folder.name} | {campaign.info['runs']}, {failed} " if name == "formation_error_rms_m" else "| | "
            )
            print(f"{head}| {title} | {middle:.4g} | {low:.4g} | {high:.4g} |")
        print(false_boxes_off_target(campaign))


def false_boxes_off_target(campaign: "Campaign") -> str:
    """Row of boxes while the camera was not on the target, over the runs with stored history."""
    from rpojax.flight.guidance.pointing_modes import Mode

    frames = boxes = false = 0
    for run_id in campaign.history_ids:
        history = campaign.history(run_id)
        away = ~np.isin(history["mode"], [int(Mode.LOOK)])
        present = np.asarray(history["box_present"], bool)
        frames += int(away.sum())
        boxes += int((present & away).sum())
        false += int((np.asarray(history["box_outlier"], bool) & away).sum())
    fraction = false / frames if frames else float("nan")
    return f"| | | look-away frames, boxes, false boxes | {frames} | {boxes} | {false} ({fraction:.2%}) |"


def by_run(folders: list[Path], name: str) -> dict[int, float]:
    """A metric by run number, of the runs of several campaigns that did not fail."""
    found: dict[int, float] = {}
    for folder in folders:
        campaign = open_campaign(folder)
        values = zip(campaign.run_ids.tolist(), campaign.metrics[name].tolist(), strict=True)
        found |= {run_id: value for run_id, value in values if np.isfinite(value)}
    return found


def paired(first: list[Path], second: list[Path], name: str) -> np.ndarray:
    """A metric (2, runs) of the runs that both have; run n has the same dispersions in both."""
    one, other = by_run(first, name), by_run(second, name)
    both = sorted(one.keys() & other.keys())
    return np.array([[one[run] for run in both], [other[run] for run in both]])


def equivalence(rendered: list[Path], statistical: list[Path], seed: int = 0) -> bool:
    """Whether the cameras are equivalent: ratios of medians with 90 % bootstrap intervals, detection rates."""
    rng = np.random.default_rng(seed)
    equivalent = True
    print("| quantity | pairs | rendered | statistical | ratio or difference | 90 % interval | bound | holds |")
    print("|---|---|---|---|---|---|---|---|")
    for name in RATIOS:
        a, b = paired(rendered, statistical, name)
        resampled = rng.integers(0, len(a), (RESAMPLES, len(a)))
        medians = [np.median(x[resampled], axis=1) for x in (a, b)]
        low, high = np.percentile(medians[1] / medians[0], [5, 95])
        holds = bool(RATIO_BOUNDS[0] <= low and high <= RATIO_BOUNDS[1])
        equivalent &= holds
        first, second = np.median(a), np.median(b)
        bound = f"{RATIO_BOUNDS[0]} to {RATIO_BOUNDS[1]}"
        print(f"| {METRICS[name]}, median | {len(a)} | {first:.3f} | {second:.3f} | {second / first:.3f} ", end="")
        print(f"| {low:.3f} to {high:.3f} | {bound} | {holds} |")
    a, b = paired(rendered, statistical, "detection_rate")
    first, second = a.mean(), b.mean()
    holds = bool(abs(second - first) <= RATE_BOUND)
    print(f"| detection rate, mean | {len(a)} | {first:.4f} | {second:.4f} ", end="")
    print(f"| {second - first:+.4f} | | {RATE_BOUND} | {holds} |")
    return equivalent and holds


def main() -> int:
    """Runs the part asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    one = parts.add_parser("run")
    one.add_argument("--scenario", default="inspection")
    one.add_argument("--model", default="rendered", choices=["rendered", "statistical", "geometric"])
    one.add_argument("--runs", type=int, default=20)
    one.add_argument("--first-run", type=int, default=0)
    one.add_argument("--duration", type=float, default=3000.0)
    one.add_argument("--seed", type=int, default=0)
    one.add_argument("--block-size", type=int, default=None)
    two = parts.add_parser("table")
    two.add_argument("folders", type=Path, nargs="+")
    three = parts.add_parser("equivalence")
    three.add_argument("rendered", type=Path, nargs="+")
    three.add_argument("--statistical", type=Path, nargs="+", required=True)
    arguments = parser.parse_args()
    if arguments.part == "run":
        run(
            arguments.scenario,
            arguments.model,
            arguments.runs,
            arguments.first_run,
            arguments.duration,
            arguments.seed,
            arguments.block_size,
        )
        return 0
    if arguments.part == "table":
        table(arguments.folders)
        return 0
    return 0 if equivalence(arguments.rendered, arguments.statistical) else 1


if __name__ == "__main__":
    raise SystemExit(main())
