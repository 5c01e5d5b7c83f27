"""Prints the covariance of the errors with which a mission keeps to its reference.

python experiments/missions/errors_of_state.py safety_ellipse --from-s 10000 [--to-s 16000] [--runs 256] [--seed 1]

A mission that begins on a relative orbit is handed over by one that has kept to it: its dispersion at the start.
Errors are of the position in H [m] and of its derivative seen in H [m/s], of all runs and seconds of the window.
"""

import argparse

import numpy as np

import rpojax

rpojax.prepare_process()

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.campaign.execution.block_recording import ChannelRecorder  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

HALF_DIFFERENCE_TICKS = 10
"""Of the central difference that gives the velocity: noise of single precision stays below 1e-6 m/s."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--from-s", type=int, required=True)
    parser.add_argument("--to-s", type=int, default=16_000)
    parser.add_argument("--runs", type=int, default=256)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    overrides = [f"duration_s={options.to_s}", "coverage.enabled=false", "requirements=[]"]
    file = scenario_loader.load(options.scenario, overrides)
    engine = BatchEngine(file, runs_per_device=64)
    errors = []
    for first in range(0, options.runs, engine.capacity):
        recorder = ChannelRecorder(engine.scenario.ticks, (), lambda _: False)
        for segment in engine.simulate(engine.prepare(options.seed, np.arange(first, first + engine.capacity))):
            recorder.add_segment(segment)
        records = recorder.records_of_runs(slice(min(engine.capacity, options.runs - first)))
        position = records["rho_H"].astype(float) - records["rho_desired_H"].astype(float)
        step = 2 * HALF_DIFFERENCE_TICKS
        velocity = (position[:, step:] - position[:, :-step]) / (step * engine.scenario.tick_s)
        state = np.concatenate([position[:, HALF_DIFFERENCE_TICKS:-HALF_DIFFERENCE_TICKS], velocity], axis=2)
        errors.append(state[records["running"][:, -1], options.from_s :])
    found = np.concatenate(errors).reshape(-1, 6)
    print("mean", np.array2string(found.mean(axis=0), precision=2))
    print("sigma", np.array2string(found.std(axis=0), precision=2))
    print("covariance")
    print(np.array2string(np.cov(found.T), precision=1, separator=", "))


if __name__ == "__main__":
    main()
