"""How runs with a target that looks alike in several attitudes end, at several probabilities of a swap.

    python -m experiments.pose.symmetric_runs DIR/pose_symmetric.toml --out OUT [--runs 1000] [--swaps 0.1 0.3 0.5]

The scenario is one of `symmetric_target`. A run ends right or wrong if flight software says at its last tick that it
knows the attitude, with an error below or above 10 deg. The exit status is 1 if a run ends wrong.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import rpojax

WRONG_DEG = 10.0


@rpojax.metric("end")
def known_at_end(target_attitude_known: jax.Array) -> jax.Array:
    """Whether the attitude is known, as 0 or 1."""
    return jnp.where(target_attitude_known, 1.0, 0.0)


@rpojax.metric("end")
def error_at_end(target_attitude_error_T_deg: jax.Array) -> jax.Array:
    """Error of the attitude, whether known or not [deg]."""
    return jnp.linalg.norm(target_attitude_error_T_deg)


@rpojax.metric("mean")
def known_share(target_attitude_known: jax.Array) -> jax.Array:
    """Share of the run in which the attitude is known."""
    return jnp.where(target_attitude_known, 1.0, 0.0)


@rpojax.metric("mean")
def wrong_share(target_attitude_known: jax.Array, target_attitude_error_T_deg: jax.Array) -> jax.Array:
    """Share of the run in which it is known and wrong."""
    return jnp.where(target_attitude_known & (jnp.linalg.norm(target_attitude_error_T_deg) > WRONG_DEG), 1.0, 0.0)


METRICS = {each.__name__: each for each in (known_at_end, error_at_end, known_share, wrong_share)}


def ends(scenario: Path, swap: float, runs: int, seed: int, out: Path, overrides: list[str]) -> int:
    """Prints how runs end; returns how many are wrong."""
    file = rpojax.load(scenario, [*overrides, f"landmarks.swap_probability={swap}"])
    made = rpojax.run_campaign(file, runs, out, seed, histories=[], metrics=METRICS, report=False, force=True)
    found = {name: np.asarray(made.metrics[name]) for name in METRICS}
    known, right = found["known_at_end"] > 0.5, found["error_at_end"] < WRONG_DEG
    pose = np.asarray(made.metrics["nees_pose_mean"]) / 6.0
    error = np.asarray(made.metrics["target_attitude_error_deg"])
    print(
        f"swap {swap:g}: {np.sum(known & right)} right, {np.sum(known & ~right)} wrong, {np.sum(~known)} not known; "
        f"known in {np.mean(found['known_share']):.1%}, known and wrong in {np.mean(found['wrong_share']):.3%} "
        f"of the time and in {np.sum(found['wrong_share'] > 0.0)} runs at all"
    )
    if known.any():
        print(
            f"  attitude error of a run {np.nanmedian(error):.3f} deg in the median, {np.nanpercentile(error, 95):.3f} "
            f"at 95 %; NEES over 6 {np.nanmean(pose):.2f} in the mean"
        )
    return int(np.sum(known & ~right))


def main() -> int:
    """Prints a line of each probability."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--swaps", type=float, nargs="+", default=[0.1, 0.3, 0.5])
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    asked = parser.parse_args()
    rpojax.prepare_process()
    wrong = [
        ends(asked.scenario, swap, asked.runs, asked.seed, asked.out / f"swap_{swap:g}", asked.overrides)
        for swap in asked.swaps
    ]
    return int(any(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
