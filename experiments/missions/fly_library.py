"""Flies the packaged missions with phases and prints what they must show.

python experiments/missions/fly_library.py --runs 1000 [--seed 1] [--only vbar_approach ...]
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator

import numpy as np

import rpojax

rpojax.prepare_process()

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.campaign.execution.block_recording import ChannelRecorder  # noqa: E402
from rpojax.flight.mission.mission_state import AbortReason  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402
from rpojax.scenario.schema import ScenarioFile  # noqa: E402
from rpojax.simulation.outcomes import judgement  # noqa: E402
from rpojax.simulation.outcomes.outcome_kinds import of_codes  # noqa: E402

MISSIONS = (
    "safety_ellipse",
    "fly_around",
    "vbar_approach",
    "rbar_approach",
    "rendezvous",
    "geo_inspection",
    "elliptic_rendezvous",
    "inspection_abort",
)
Runs = dict[str, np.ndarray]
RECORDED_S = 800_000.0
"""Time of all runs of a block on one device [s]; its records take about 1 kB a second."""


def blocks(file: ScenarioFile, runs: int, seed: int) -> Iterator[Runs]:
    """Records (runs, ticks, ...), values used and what was judged from them, block by block."""
    engine = BatchEngine(file, runs_per_device=max(1, min(64, -(-runs // 2), int(RECORDED_S / file.duration_s))))
    kept = ("rho_H", "rho_desired_H", "phase", "abort_reason", "range_m", "nees_relative", "delta_v_m_s",
            "relative_error_H", "relative_sigma_H")  # fmt: skip
    for first in range(0, runs, engine.capacity):
        prepared = engine.prepare(seed, np.arange(first, first + engine.capacity))
        recorder = ChannelRecorder(engine.scenario.ticks, (), lambda _: False)
        last = None
        for last in engine.simulate(prepared):
            recorder.add_segment(last)
        assert last is not None
        count = min(engine.capacity, runs - first)
        records = recorder.records_of_runs(slice(count))
        used = {key: values[:count] for key, values in prepared.used.items()}
        judged = judgement.judge(file, used, records, last.failure[:count], last.failed_at[:count])
        safety = engine.passive_safety.evaluate(prepared.drawn, recorder.records)
        found = {name: records[name] for name in kept} | {"outcome": of_codes(judged.codes)} | used
        yield found | {name: values[:count] for name, values in safety.items()}


def figures(file: ScenarioFile, run: Runs) -> dict[str, list[float]]:
    """Figures of each run of a block, by name."""
    names = [phase.name for phase in file.phases]
    error = np.linalg.norm(run["rho_H"] - run["rho_desired_H"], axis=2)
    tick_s = 1.0 / file.rates.camera_hz
    found: dict[str, list[float]] = {"least range [m]": list(run["range_m"].min(axis=1))}
    for name in ("passive_range_24_h_m", "passive_unsafe_fraction"):
        found[name] = list(run[name])
    inside_bounds = np.abs(run["relative_error_H"]) <= 3.0 * run["relative_sigma_H"]
    found["3-sigma coverage"] = list(inside_bounds.mean(axis=(1, 2)))
    for row, name in enumerate(names):
        inside = run["phase"] == row
        found[f"{name}: NEES/6"] = [
            float(run["nees_relative"][i][inside[i]].mean() / 6) for i in np.flatnonzero(inside.any(1))
        ]
        late = [np.flatnonzero(each)[int(each.sum()) // 2 :] for each in inside]
        found[f"{name}: late RMS error [m]"] = [
            float(np.sqrt(np.mean(error[i][ticks] ** 2))) for i, ticks in enumerate(late) if len(ticks)
        ]
    if "hold_12" in names:
        found |= _approach(file, run, names.index("hold_12"), tick_s)
    return found


def _approach(file: ScenarioFile, run: Runs, last: int, tick_s: float) -> dict[str, list[float]]:
    """Lateral error on arrival at 12 m, and greatest mean closing speed over a control period inside 20 m."""
    axis = int(np.argmax(np.abs(file.phases[-1].corridor.axis)))  # pyright: ignore[reportOptionalMemberAccess]
    across = [number for number in range(3) if number != axis]
    span = round(140.0 / tick_s)
    lateral, closing = [], []
    for rho, phase, distance in zip(run["rho_H"], run["phase"], run["range_m"], strict=True):
        if (phase == last).any():
            lateral.append(float(np.linalg.norm(rho[np.argmax(phase == last), across])))
        near = np.flatnonzero((distance[:-span] < 20.0) & (phase[:-span] <= last))
        if len(near):
            closing.append(float(np.max(distance[near] - distance[near + span]) / (span * tick_s)))
    found = {"lateral error at 12 m [m]": lateral, "closing speed inside 20 m [m/s]": closing}
    return found | {"most of the corridor's radius, completed runs [-]": _share_of_corridor(file, run)}


def _share_of_corridor(file: ScenarioFile, run: Runs) -> list[float]:
    """Greatest true distance from the corridor's axis over the corridor's radius there, of each completed run."""
    shares = np.zeros(len(run["range_m"]))
    for row, phase in enumerate(file.phases):
        if phase.corridor is None:
            continue
        axis = np.array(phase.corridor.axis) / np.linalg.norm(phase.corridor.axis)
        ahead = run["rho_H"].astype(float) @ axis
        aside = np.linalg.norm(run["rho_H"] - ahead[..., None] * axis, axis=2)
        radius = phase.corridor.width_m + ahead * np.tan(np.radians(phase.corridor.half_angle_deg))
        shares = np.maximum(shares, np.max(np.where(run["phase"] == row, aside / radius, 0.0), axis=1))
    return shares[run["outcome"] == "completed"].tolist()


def _quantiles(column: list[float]) -> dict[str, float]:
    found = [np.nanmean(column), *np.nanquantile(column, (0.0, 0.5, 0.99, 1.0))]
    return dict(zip(("mean", "least", "p50", "p99", "most"), np.round(found, 4).tolist(), strict=True))


def main() -> None:
    """Prints one line of JSON per mission."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=MISSIONS)
    arguments = parser.parse_args()
    for name in arguments.only:
        file, begin = scenario_loader.load(name), time.perf_counter()
        outcomes, reasons, values = Counter(), Counter(), {}
        strayed: list[int] = []
        for run in blocks(file, arguments.runs, arguments.seed):
            is_bad = ~np.isin(run["outcome"], ("completed", "aborted"))
            strayed += (outcomes.total() + np.flatnonzero(is_bad)).tolist()
            outcomes.update(run["outcome"].tolist())
            reasons.update(AbortReason(int(code)).name for code in run["abort_reason"][:, -1] if code)
            for key, column in figures(file, run).items():
                values.setdefault(key, []).extend(column)
        quantiles = {key: _quantiles(column) for key, column in values.items() if column}
        unsafe = int(np.sum(np.array(values["passive_unsafe_fraction"]) > 0.0))
        print(
            json.dumps(
                {
                    "mission": name,
                    "runs": arguments.runs,
                    "outcomes": outcomes,
                    "aborts": reasons,
                    "runs with an unsafe instant": unsafe,
                    "runs with a coverage below 95 %": int(np.sum(np.array(values["3-sigma coverage"]) < 0.95)),
                    "runs that entered or diverged": strayed,
                    **quantiles,
                    "wall_s": round(time.perf_counter() - begin),
                }
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
