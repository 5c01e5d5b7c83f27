"""Hardware that differs from what the filter believes, drawn at its believed sigma, at three times it, and far beyond.

python experiments/mismatch/mismatch_table.py --out DIR [--runs 256] [--seed 11] [--only NAME ...]

The exit status is 1 if a run is completed with a coverage below 90 %, or a run enters the keep-out sphere.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unseen_missions"))

import mission_campaigns
from mission_campaigns import Variant, mean, percent

import rpojax
from rpojax.simulation.outcomes.outcome_kinds import Outcome

Draw = Callable[[np.random.Generator, int], np.ndarray]

THRUST_SIGMA = 0.02
DIRECTION_SIGMA_DEG = 0.3
MOUNTING_SIGMA_DEG = 0.1
DRAG = ("effects.drag=true", "effects.solar_pressure=true")
FAULTS = ("effects.faults=true",)
WELL_BELOW = 0.9
"""Coverage below which no run may be completed."""


def around(mean: float, sigma: float) -> Draw:
    """Draws a number."""
    return lambda rng, runs: mean + sigma * rng.normal(size=runs)


def between(low: float, high: float) -> Draw:
    """Draws a number, uniformly."""
    return lambda rng, runs: rng.uniform(low, high, runs)


def either_side(mean: float, offset: float) -> Draw:
    """One of two numbers, equally likely."""
    return lambda rng, runs: mean + offset * rng.choice([-1.0, 1.0], size=runs)


def across_x(sigma_deg: float) -> Draw:
    """Rotations about y and z, each drawn: those that turn an axis x of the body."""
    return lambda rng, runs: sigma_deg * rng.normal(size=(runs, 3)) * np.array([0.0, 1.0, 1.0])


def turned_by(angle_deg: float) -> Draw:
    """Rotations of one size about an axis across x, in any direction."""

    def draw(rng: np.random.Generator, runs: int) -> np.ndarray:
        turn = rng.uniform(0.0, 2.0 * np.pi, runs)
        return angle_deg * np.stack([np.zeros(runs), np.cos(turn), np.sin(turn)], axis=1)

    return draw


def in_picture(angle_deg: float) -> Draw:
    """The same of the camera, whose boresight is z."""
    turn = turned_by(angle_deg)
    return lambda rng, runs: np.roll(turn(rng, runs), -1, axis=1)


def camera_drawn(sigma_deg: float) -> Draw:
    """Rotations about x and y of the camera, each drawn."""
    drawn = across_x(sigma_deg)
    return lambda rng, runs: np.roll(drawn(rng, runs), -1, axis=1)


THRUST, DIRECTION, CAMERA = "thruster.force_scale", "thruster.misalignment_deg", "camera.misalignment_deg"
AREA = "target_surface.area_m2"

VARIANTS: dict[str, Variant] = {
    "as packaged": Variant({}),
    "thrust drawn": Variant({THRUST: around(1.0, THRUST_SIGMA)}),
    "direction drawn": Variant({DIRECTION: across_x(DIRECTION_SIGMA_DEG)}),
    "mounting drawn": Variant({CAMERA: camera_drawn(MOUNTING_SIGMA_DEG)}),
    "thrust 3 sigma": Variant({THRUST: either_side(1.0, 3.0 * THRUST_SIGMA)}),
    "direction 3 sigma": Variant({DIRECTION: turned_by(3.0 * DIRECTION_SIGMA_DEG)}),
    "mounting 3 sigma": Variant({CAMERA: in_picture(3.0 * MOUNTING_SIGMA_DEG)}),
    "thrust 20 % low": Variant({THRUST: 0.8}),
    "thrust 30 % high": Variant({THRUST: 1.3}),
    "thruster misaligned by 2 deg": Variant({DIRECTION: turned_by(2.0)}),
    "camera 0.4 deg off": Variant({CAMERA: in_picture(0.4)}),
    "half of the boxes false": Variant({"camera.outlier_probability": 0.5}),
    "drag at 500 km": Variant({}, overrides=DRAG),
    "drag at 420 km": Variant({"orbit.semi_major_axis_m": 6798137.0}, overrides=DRAG),
    "drag at 420 km, three times the difference": Variant(
        {"orbit.semi_major_axis_m": 6798137.0, AREA: 1.5}, overrides=DRAG
    ),
    "drag at 350 km": Variant(
        {"orbit.semi_major_axis_m": 6728137.0, "atmosphere.density_kg_m3": 1e-12}, overrides=DRAG
    ),
    "star tracker blind": Variant(
        {"faults.fault.start_s": between(500.0, 4000.0), "faults.fault.duration_s": between(300.0, 1500.0)},
        overrides=(*FAULTS, "faults.fault.kind=star_tracker_blind"),
    ),
    "wheel stuck": Variant(
        {
            "faults.fault.start_s": between(500.0, 4000.0),
            "faults.fault.wheel": lambda rng, runs: rng.integers(0, 3, runs) * 1.0,
        },
        overrides=(*FAULTS, "faults.fault.kind=wheel_stuck"),
    ),
}
"""Mismatches by name."""


def main() -> int:
    """Simulates the variants and prints the table; what misses a bar is in bold."""
    parser = mission_campaigns.parser(__doc__, runs=256)
    parser.add_argument("--only", nargs="*", choices=VARIANTS, default=list(VARIANTS))
    options = parser.parse_args()
    print(f"{options.runs} runs each, seed {options.seed}.\n")
    mission_campaigns.header(
        "mismatch",
        "3-sigma coverage",
        "runs below 90 %",
        "of these completed",
        "relative NEES / 6",
        "below 90 % and never withdrawn",
        "confidence withdrawn",
        "first at, median",
        "formation error, median and p95",
        "outcomes",
    )
    failed = False
    for name, campaign, rows in mission_campaigns.variant_campaigns(
        {name: VARIANTS[name] for name in options.only}, options, 0
    ):
        failed |= _is_bad(campaign, rows)
        mission_campaigns.row(name, *cells(campaign, rows))
    return int(failed)


def _is_bad(campaign: rpojax.Campaign, rows: slice) -> bool:
    outcomes, coverage = campaign.outcomes[rows], campaign.metrics["sigma3_coverage"][rows]
    completed = outcomes == Outcome.COMPLETED
    return bool(np.any(completed & (coverage < WELL_BELOW)) or np.any(outcomes == Outcome.KEEP_OUT))


def cells(campaign: rpojax.Campaign, rows: slice) -> list[str]:
    """Figures of one variant."""
    metrics = {key: values[rows] for key, values in campaign.metrics.items()}
    outcomes, coverage, nees = campaign.outcomes[rows], metrics["sigma3_coverage"], metrics["nees_relative_mean"]
    low = coverage < WELL_BELOW
    completed = outcomes == Outcome.COMPLETED
    withdrawn_s = metrics.get("confidence_withdrawn_s", np.full(len(coverage), np.nan))
    withdrawn = np.isfinite(withdrawn_s) if "confidence_withdrawn_s" in metrics else metrics["confident_fraction"] < 1.0
    silent = int((low & completed).sum())
    formation = metrics["formation_error_rms_m"]
    return [
        percent(mean(coverage), 2),
        percent(float(low.mean())),
        f"{silent}" if not silent else f"**{silent}**",
        f"{mean(nees) / 6.0:.2f}",
        percent(float((low & ~withdrawn).mean())),
        percent(float(withdrawn.mean())),
        f"{np.nanmedian(withdrawn_s):.0f} s" if np.isfinite(withdrawn_s).any() else "-",
        f"{np.nanmedian(formation):.3f} m, {np.nanpercentile(formation, 95):.3f} m",
        mission_campaigns.outcome_counts(outcomes),
    ]


if __name__ == "__main__":
    sys.exit(main())
