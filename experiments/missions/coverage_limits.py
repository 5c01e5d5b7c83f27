"""Tells what limits the coverage of an inspection: flight, camera, or the geometry of orbit, light and tumble.

    python experiments/missions/coverage_limits.py safety_ellipse [--runs 128] [--seed 1]

The recorded coverage is evaluated again as if a box had been accepted in every frame, and as if the servicer had kept
exactly to its reference, too, with the camera on the target all the time. What is not seen then is not to be seen.
"""

import argparse
import json

import numpy as np
from scipy.spatial.transform import Rotation

import rpojax

rpojax.prepare_process()

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.campaign.execution.block_recording import ChannelRecorder  # noqa: E402
from rpojax.campaign.execution.surface_coverage import REQUIRED_CHANNELS  # noqa: E402
from rpojax.metrics.surface_coverage import SEEN_FRACTION  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

RECORDED = frozenset((*REQUIRED_CHANNELS, "rho_desired_H"))
Records = dict[str, np.ndarray]
AS_FLOWN, ALL_FRAMES, ON_REFERENCE = "as flown", "all frames accepted", "on the reference, camera on the target"


def all_frames(records: Records) -> Records:
    """Records (ticks, ..., runs) with a box accepted in every frame."""
    return records | {"box_accepted": np.ones_like(records["box_accepted"])}


def on_reference(records: Records, mounting: list[float], tick_s: float) -> Records:
    """Records of a servicer that is where its reference is, with the camera on the target."""
    r_TN_N, desired_H = (np.moveaxis(records[name], -1, 1).astype(float) for name in ("r_TN_N", "rho_desired_H"))
    radial = r_TN_N / np.linalg.norm(r_TN_N, axis=2, keepdims=True)
    normal = np.cross(r_TN_N, np.gradient(r_TN_N, tick_s, axis=0))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    axes = np.stack([radial, np.cross(normal, radial), normal], axis=2)
    r_ST_N = np.einsum("trij,tri->trj", axes, desired_H)
    ahead = -r_ST_N / np.linalg.norm(r_ST_N, axis=2, keepdims=True)
    right = normal - np.sum(normal * ahead, axis=2, keepdims=True) * ahead
    right /= np.linalg.norm(right, axis=2, keepdims=True)
    R_KN = np.stack([right, np.cross(ahead, right), ahead], axis=2)
    R_KB = Rotation.from_quat(np.roll(mounting, -1)).as_matrix()
    R_BN = np.einsum("ki,trkj->trij", R_KB, R_KN)
    q_BN = np.roll(Rotation.from_matrix(R_BN.reshape(-1, 3, 3)).as_quat(), 1, axis=1).reshape(*R_BN.shape[:2], 4)
    places = {"r_ST_N": r_ST_N, "q_BN": q_BN}
    return all_frames(records) | {name: np.moveaxis(each, 1, -1).astype(np.float32) for name, each in places.items()}


def main() -> None:
    """Prints one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--runs", type=int, default=128)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    file = scenario_loader.load(options.scenario)
    engine = BatchEngine(file, runs_per_device=16)
    found: dict[str, list[float]] = {AS_FLOWN: [], ALL_FRAMES: [], ON_REFERENCE: []}
    for first in range(0, options.runs, engine.capacity):
        prepared = engine.prepare(options.seed, np.arange(first, first + engine.capacity))
        recorder = ChannelRecorder(engine.scenario.ticks, (), lambda _: False, RECORDED)
        for segment in engine.simulate(prepared):
            recorder.add_segment(segment)
        records = dict(recorder.records)
        variants = {
            AS_FLOWN: records,
            ALL_FRAMES: all_frames(records),
            ON_REFERENCE: on_reference(records, file.camera.mounting, engine.scenario.tick_s),
        }
        for name, each in variants.items():
            found[name] += engine.coverage.evaluate(prepared.drawn, each).metrics[SEEN_FRACTION].tolist()
    seen = {name: np.array(values[: options.runs]) for name, values in found.items()}
    short = seen[AS_FLOWN] < 0.9
    lines = {
        name: {
            "median": round(float(np.median(values)), 4),
            "least": round(float(values.min()), 4),
            "below 90 %": round(float(np.mean(values < 0.9)), 4),
        }
        for name, values in seen.items()
    }
    lost = seen[ON_REFERENCE][short] - seen[AS_FLOWN][short]
    both = {"runs": options.runs, "of runs below 90 %, the reference would add": np.quantile(lost, (0.5, 1.0)).round(4)}
    print(json.dumps({"mission": options.scenario, **lines, **both}, default=lambda each: each.tolist()))


if __name__ == "__main__":
    main()
