"""Simulates teams of servicers and prints what sharing gives: errors, consistency, time unseen, distances.

python experiments/several_observers/measure.py [--runs 64] [--seed 1] [--only GROUP ...] [--out FILE]

Groups: geometry, far, losses, outage, size, black_camera. One line of JSON per case; figures are those of the second
half of each run unless they say otherwise.
"""

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import rpojax

rpojax.prepare_process()

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.core.pytree import concatenate  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402
from rpojax.simulation.channels import CHANNELS  # noqa: E402

Channels = dict[str, np.ndarray]
Case = tuple[str, str, list[str]]
"""Name, scenario, overrides."""

STATIONS = str(Path(__file__).parent / "stations.toml")
KEPT = ("nees_relative", "relative_error_H", "relative_sigma_H", "rho_H", "rho_desired_H", "box_accepted", "running",
        "log_size")  # fmt: skip
"""Channels that are kept, of those that the scenario has: only phases have a desired position that moves."""
CARRIER = [
    "gps_differences.kind=carrier",
    "navigation.difference_noise_m=0.05",
    "navigation.difference_error_sigma_m=0.007",
]
SHORT = ["duration_s=3000"]
UNHEARD = "team.keep_out_m=0"
"""Without messages nobody knows where the others are."""
SIZE = 1.5
"""True size over the belief, where the size is wrong."""

CHANNELS["log_size"] = lambda tick: tick.telemetry.flight.orbit.relative.slow["size"][0]


def stations(angle_deg: float, overrides: list[str]) -> list[str]:
    """Overrides of the stations for another angle between them, in the plane of along-track and cross-track."""
    along, across = -np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    place = [0.0, float(np.round(30.0 * along, 3)), float(np.round(30.0 * across, 3))]
    start = [float(np.round(number * 32.0 / 30.0, 3)) for number in place]
    return [
        f"servicers.aside.initial.relative_position_m={start}",
        f"servicers.aside.formation.desired_position_m={place}",
        *overrides,
    ]


def groups() -> dict[str, list[Case]]:
    """Cases by group."""
    sharing = ("boxes", "estimates", "central", "naive")
    ellipse = "cooperative_inspection"
    return {
        "geometry": [
            *(
                (f"{angle} deg apart, {kind} differences", STATIONS, stations(angle, more))
                for angle in (20, 90, 180)
                for kind, more in (("code", []), ("carrier", CARRIER))
            ),
            ("90 deg apart, alone", STATIONS, stations(90, ["navigation.sharing=none"])),
        ],
        "far": [
            ("two at 200 m", "cooperative_far", []),
            ("two at 200 m, alone", "cooperative_far", ["navigation.sharing=none", UNHEARD]),
        ],
        "losses": [
            ("none", ellipse, [*SHORT, "navigation.sharing=none", UNHEARD]),
            *((f"{method}, no loss", ellipse, [*SHORT, f"navigation.sharing={method}"]) for method in sharing),
            *(
                (
                    f"{method}, {loss} % loss",
                    ellipse,
                    [*SHORT, f"navigation.sharing={method}", f"link.loss={loss / 100}"],
                )
                for method in ("boxes", "estimates")
                for loss in (20, 30, 50, 90)
            ),
        ],
        "outage": [
            (
                f"{method}, half an hour without links",
                ellipse,
                ["duration_s=4000", f"navigation.sharing={method}", *more],
            )
            for method, more in (
                ("none", [UNHEARD]),
                ("boxes", ["link.outages_s=[[1500.0, 3300.0]]"]),
                ("estimates", ["link.outages_s=[[1500.0, 3300.0]]"]),
            )
        ],
        "size": [
            (
                f"size {SIZE} of the belief, sigma 0.5",
                ellipse,
                [*SHORT, f"target.scale={SIZE}", "navigation.target_size_sigma=0.5"],
            )
        ],
        "black_camera": [
            (
                "camera of the second one black for 30 minutes",
                ellipse,
                [
                    "duration_s=4500",
                    "effects.faults=true",
                    "faults.fault.kind=none",
                    "servicers.second.faults.fault.kind=camera_blackout",
                    "servicers.second.faults.fault.start_s=1500.0",
                    "servicers.second.faults.fault.duration_s=1800.0",
                ],
            )
        ],
    }


def simulate(case: Case, runs: int, seed: int) -> tuple[Channels, float]:
    """Channels (ticks, runs, ..., servicers) of the runs of a case, and the length of a tick [s]."""
    _, scenario, overrides = case
    engine = BatchEngine(scenario_loader.load(scenario, overrides), min(24, -(-runs // 2)))
    parts: list[Channels] = []
    for first in range(0, runs, engine.capacity):
        prepared = engine.prepare(seed, np.arange(first, first + engine.capacity))
        segments = [segment.channels for segment in engine.simulate(prepared)]
        count = min(engine.capacity, runs - first)
        names = [name for name in KEPT if name in segments[0]]
        parts.append({name: np.concatenate([each[name] for each in segments])[:, :count] for name in names})
    return concatenate(parts, axis=1), engine.scenario.tick_s


def size_error(channels: Channels) -> dict[str, object]:
    """How far the size that each servicer believes at the end is from the true one, as a share of it."""
    error = np.abs(np.expm1(channels["log_size"][-1].astype(float) - np.log(SIZE)))
    return {
        f"size error at the end, {name}": _rounded(np.quantile(error, share, axis=0))
        for name, share in (("median", 0.5), ("p95 of runs", 0.95))
    }


def figures(channels: Channels, tick_s: float) -> dict[str, object]:
    """Figures of a case, of each servicer or of all."""
    half = len(channels["running"]) // 2
    late = {name: values[half:].astype(float) for name, values in channels.items()}
    error, rho = late["relative_error_H"], late["rho_H"]
    along = np.sum(error * rho, axis=2) / np.linalg.norm(rho, axis=2)
    inside = np.abs(error) <= 3.0 * late["relative_sigma_H"]
    found: dict[str, object] = {
        "NEES/6": _rounded(late["nees_relative"].mean(axis=(0, 1)) / 6.0),
        "range error rms [m]": _rounded(np.sqrt(np.mean(along**2, axis=(0, 1)))),
        "position error rms [m]": _rounded(np.sqrt(np.mean(np.sum(error**2, axis=2), axis=(0, 1)))),
        "3-sigma coverage": _rounded(inside.mean(axis=(0, 1, 2))),
        "unseen by anybody, p95 of runs [s]": float(np.quantile(_unseen(channels, tick_s), 0.95)),
        "least distance of two [m]": float(min(_distances(channels["rho_H"]), default=np.nan)),
        "runs that were frozen": int((~channels["running"][-1]).any(axis=-1).sum()),
    }
    if "rho_desired_H" in late:
        formation = np.sqrt(np.mean(np.sum((rho - late["rho_desired_H"]) ** 2, axis=2), axis=0))
        found["formation error p99 of runs [m]"] = _rounded(np.quantile(formation, 0.99, axis=0))
    return found


def _rounded(values: np.ndarray) -> list[float]:
    return np.round(values, 4).tolist()


def _unseen(channels: Channels, tick_s: float) -> np.ndarray:
    """Longest time (runs,) in which nobody accepts a box, after the first one [s]."""
    seen = channels["box_accepted"].max(axis=2)
    tick = np.arange(len(seen))[:, None]
    last = np.maximum.accumulate(np.where(seen, tick, -1), axis=0)
    return np.where(last >= 0, tick - last, 0).max(axis=0) * tick_s


def _distances(rho_H: np.ndarray) -> Iterator[float]:
    count = rho_H.shape[-1]
    for i in range(count):
        for j in range(i):
            yield float(np.linalg.norm(rho_H[..., i].astype(float) - rho_H[..., j], axis=2).min())


def main() -> None:
    """Prints one line of JSON per case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=list(groups()))
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    for group in arguments.only:
        for case in groups()[group]:
            begin = time.perf_counter()
            channels, tick_s = simulate(case, arguments.runs, arguments.seed)
            found = figures(channels, tick_s) | (size_error(channels) if group == "size" else {})
            line = {"case": case[0], "runs": arguments.runs, **found, "wall_s": round(time.perf_counter() - begin)}
            print(json.dumps(line), flush=True)
            if arguments.out:
                with arguments.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
