"""Does the report name the right cause? Failures are planted in packaged scenarios, one in each campaign.

python experiments/own_mission/planted_failures.py --out out/planted [--runs 16] [--only lens_narrow,thrust_small]

Prints a Markdown table: what was planted, failed runs, first cause that the report names, and whether it is one of
those that were planted; then causes that are named in healthy packaged campaigns. The exit status is 1 if more than one
in twelve is wrong, or a healthy campaign has a cause.
"""

import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rpojax.analysis.failure_causes import ranking
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.report.sections import cause_section


@dataclass(frozen=True)
class Planted:
    """A failure: the packaged scenario, what is set in it, and names of the causes that are right."""

    name: str
    scenario: str
    settings: Sequence[str]
    causes: Sequence[str]


PLANTED = (
    Planted("lens_narrow", "vbar_approach", ["target.scale=8.0", "navigation.target_size_m=8.504"], ["frame"]),
    Planted(
        "lens_pinhole", "inspection", ["camera.field_of_view_deg=2.0", "pointing.search_pitch_deg=1.3"], ["out_of_view"]
    ),
    Planted("lens_wide", "inspection", ["camera.field_of_view_deg=75.0"], ["too_small"]),
    Planted("eclipse_light", "inspection", ["orbit.raan_deg=0.0", "camera.phase_limit_deg=70.0"], ["dark"]),
    Planted("wheels_small", "inspection", ["wheels.speed_limit_rad_s=[60.0, 60.0, 60.0]"], ["wheels"]),
    Planted("wheels_preloaded", "inspection", ["wheels.initial_speed_rad_s=[560.0, 560.0, 560.0]"], ["wheels"]),
    Planted("thrust_small", "inspection", ["thruster.force_n=0.002"], ["authority"]),
    Planted("size_belief", "inspection", ["target.scale=1.6"], ["belief"]),
    Planted("noise_belief", "inspection", ["camera.edge_noise_px=6.0"], ["belief"]),
    Planted(
        "corridor_tight",
        "vbar_approach",
        ["phases.approach.corridor.half_angle_deg=0.3", "phases.approach.corridor.width_m=0.1"],
        ["corridor"],
    ),
    Planted("false_boxes", "inspection", ["camera.outlier_probability=0.7"], ["false_boxes"]),
    Planted("misses", "inspection", ["camera.miss_probability=0.97"], ["misses"]),
    Planted(
        "thruster_fault",
        "inspection",
        ["effects.faults=true", 'faults.fault.kind="thruster_off"', "faults.fault.start_s=300.0"],
        ["fault"],
    ),
    Planted(
        "camera_fault",
        "inspection",
        ["effects.faults=true", 'faults.fault.kind="camera_blackout"', "faults.fault.start_s=2000.0"],
        ["fault"],
    ),
    Planted(
        "phase_never_ends",
        "vbar_approach",
        ["phases.hold_100.until.range_sigma_m=0.02", 'phases.hold_100.on_timeout="hold"'],
        ["phase"],
    ),
    Planted("short_run", "vbar_approach", ["duration_s=2500.0"], ["short"]),
    Planted("star_tracker_blind", "inspection", ["star_tracker.sun_exclusion_deg=179.0"], ["star_tracker"]),
    Planted("propellant_small", "inspection", ["limits.propellant_kg=0.001"], ["propellant"]),
    Planted("minimum_burn_long", "inspection", ["thruster.minimum_on_time_s=45.0"], ["authority"]),
    Planted("camera_tilted", "inspection", ["camera.misalignment_deg=[2.0, 2.0, 0.0]"], ["belief"]),
)
BLIND = (
    Planted("radial_lens_narrow", "rbar_approach", ["target.scale=7.0", "navigation.target_size_m=7.44"], ["frame"]),
    Planted("ellipse_lens_wide", "safety_ellipse", ["camera.field_of_view_deg=90.0"], ["too_small"]),
    Planted("approach_dark", "vbar_approach", ["orbit.raan_deg=0.0", "camera.phase_limit_deg=60.0"], ["dark"]),
    Planted("approach_preloaded", "vbar_approach", ["wheels.initial_speed_rad_s=[0.0, 600.0, 600.0]"], ["wheels"]),
    Planted("radial_thrust_small", "rbar_approach", ["thruster.force_n=0.003"], ["authority"]),
    Planted("full_thrust_belief", "inspection_full", ["thruster.force_scale=1.6"], ["belief"]),
    Planted("approach_size_belief", "vbar_approach", ["navigation.target_size_m=0.6"], ["belief"]),
    Planted(
        "radial_corridor",
        "rbar_approach",
        ["phases.approach.corridor.half_angle_deg=0.5", "phases.approach.corridor.width_m=0.2"],
        ["corridor"],
    ),
    Planted("approach_false_boxes", "vbar_approach", ["camera.outlier_probability=0.75"], ["false_boxes"]),
    Planted("radial_misses", "rbar_approach", ["camera.miss_probability=0.95"], ["misses"]),
    Planted(
        "approach_weak_thruster",
        "vbar_approach",
        [
            "effects.faults=true",
            'faults.fault.kind="thruster_weak"',
            "faults.fault.severity=0.9",
            "faults.fault.start_s=1500.0",
        ],
        ["fault"],
    ),
    Planted(
        "approach_box_tiny", "vbar_approach", ["phases.approach.until.arrival_box_m=[0.01, 0.01, 0.01]"], ["phase"]
    ),
    Planted("radial_short", "rbar_approach", ["duration_s=2000.0"], ["short"]),
    Planted(
        "full_star_tracker",
        "inspection_full",
        ["star_tracker.boresight=[0.0, 1.0, 0.0]", "star_tracker.sun_exclusion_deg=170.0"],
        ["star_tracker"],
    ),
    Planted("approach_propellant", "vbar_approach", ["limits.propellant_kg=0.005"], ["propellant"]),
    Planted("torque_small", "inspection", ["wheels.torque_limit_n_m=[0.001, 0.001, 0.001]"], ["wheels"]),
)
"""Planted after the rules had been written, on other missions: what the rules do not know."""
HEALTHY = {
    "inspection": (),
    "vbar_approach": (),
    "inspection_eclipse": (),
    "inspection_faults": ("fault",),
}
"""Packaged scenarios, and causes that may be named there."""


def simulated(scenario: str, settings: Sequence[str], runs: int, folder: Path) -> Campaign:
    """The campaign of a scenario with settings, simulated unless it is there."""
    if not (folder / "campaign.json").exists():
        command = [sys.executable, "-m", "rpojax", "campaign", scenario, "--runs", str(runs), "--out", str(folder)]
        for setting in settings:
            command += ["--set", setting]
        done = subprocess.run(
            [*command, "--no-report", "--json", "--histories", "none"], capture_output=True, text=True
        )
        if done.returncode not in (0, 3):
            raise SystemExit(f"{scenario} {settings}: {done.stderr}")
    return Campaign(folder)


def shown(campaign: Campaign) -> str:
    """Which causes completed runs show, by the number of runs: what contrast must reject where a run fails."""
    evidence = cause_section.evidence_of(campaign, campaign.file)
    counts = Counter[str]()
    for finding in ranking.all_findings(evidence):
        counts[finding.name] += int((finding.shown & evidence.completed).sum())
    found = ", ".join(f"{name} ({count})" for name, count in counts.most_common() if count)
    return f"completed runs show {found or 'none'}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the campaigns")
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--only", default="", help="names, separated by commas")
    options = parser.parse_args()
    chosen = [each for each in (*PLANTED, *BLIND) if not options.only or each.name in options.only.split(",")]
    right = 0
    print("| planted | failed | first cause | right |\n|---|---|---|---|")
    for each in chosen:
        found = cause_section.content(simulated(each.scenario, each.settings, options.runs, options.out / each.name))
        first = found["causes"][0] if found["causes"] else None
        is_right = first is not None and first["name"] in each.causes
        right += is_right
        text = "none" if first is None else f"{first['name']}: {first['text']}"
        print(
            f"| {each.name} | {found['failed']} of {found['runs']} | {text} | {'yes' if is_right else 'no'} |",
            flush=True,
        )
    print(f"\n{right} of {len(chosen)} right\n")
    wrong = 0
    for scenario, allowed in HEALTHY.items() if not options.only else ():
        campaign = simulated(scenario, [], options.runs, options.out / f"healthy_{scenario}")
        found = cause_section.content(campaign)
        names = ", ".join(f"{each['name']} ({each['runs']})" for each in found["causes"]) or "none"
        wrong += any(each["name"] not in allowed for each in found["causes"])
        failed = f"{found['failed']} of {found['runs']} failed"
        print(f"- {scenario}: {failed}, causes: {names}; {shown(campaign)}", flush=True)
    return int(12 * (len(chosen) - right) > len(chosen) or wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
