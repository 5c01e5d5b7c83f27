"""Sensitivities by derivatives of 16 runs, and by thousands of sampled ones; prints tables.

python experiments/worst_case/sensitivities.py --out out/worst [--runs 15]

The sampled campaign is that of measure.py, in the same folder.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=1")
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path.home() / ".cache" / "rpojax" / "jax"))

import numpy as np

import rpojax
from rpojax.analysis.gradients import derivative_sensitivity
from rpojax.analysis.gradients.derivative_sensitivity import MetricSensitivity, RankingAgreement
from rpojax.analysis.reliability.simulated_limit_state import make_evaluator
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.parameter_keys import component_columns

METRICS = ("nav_relative_position_error_rms_m", "formation_error_rms_m", "min_range_m", "delta_v_m_s")
SETTINGS = ["duration_s=2000.0"]
BATCH, ROWS = 4, 8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=15)
    given = parser.parse_args()
    sampled = Campaign(given.out / "campaign")
    space = standard_normal_space.make_space(rpojax.load("inspection", SETTINGS))
    evaluator = make_evaluator(space, METRICS, BATCH)
    begin = time.process_time()
    found = derivative_sensitivity.derivative_sensitivities(space, METRICS, given.runs, 0, evaluator)
    print(
        f"processor time {time.process_time() - begin:.0f} s with compilation, which took {evaluator.compile_s:.0f} s"
    )
    columns = {name: column for name, column in component_columns(sampled.drawn).items() if np.isfinite(column).all()}
    for one in found:
        beside = derivative_sensitivity.compare_with_sampling(one, space, columns, sampled.metrics[one.metric])
        assert beside is not None
        show(one, beside)


def show(one: MetricSensitivity, beside: RankingAgreement) -> None:
    """Table of one metric."""
    print(
        f"\n`{one.metric}`: {one.sigma:.3g} {one.unit} by derivatives of {len(one.values)} runs, standard deviation of "
        f"{beside.runs} sampled ones {beside.std:.3g} {one.unit}; {len(beside.both)} of "
        f"{derivative_sensitivity.LEADING} leading inputs agree, rank correlation of both orders "
        f"{beside.rank_correlation:.2f}\n"
    )
    print(f"| input | trend [{one.unit}] | sigma | of the median run | most of one run | by sampling | place there |")
    print("|---|---|---|---|---|---|---|")
    order = sorted(beside.strengths, key=lambda name: -beside.strengths[name])
    for share in one.shares[:ROWS]:
        strength, place = beside.strengths[share.name], order.index(share.name) + 1
        print(
            f"| `{share.name}` | {share.trend:.3g} | {share.sigma:.3g} | {share.nominal:.3g} | "
            f"{100.0 * share.one_run:.0f} % | {strength:.2f} | {place} |"
        )


if __name__ == "__main__":
    main()
