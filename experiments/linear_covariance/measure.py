"""Linear covariance of the inspection mission against sampled runs; prints two Markdown tables.

python experiments/linear_covariance/measure.py [--runs 2000]

The exit status is 1 if a row of the first table does not hold.
"""

import argparse
import os

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

from rpojax.analysis.linear_covariance import covariance_propagation, monte_carlo_agreement
from rpojax.analysis.linear_covariance.covariance_propagation import LinearCovariance
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS
from rpojax.analysis.linear_covariance.monte_carlo_agreement import TOLERANCE, ChannelAgreement, MonteCarloSample
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.core.pytree import concatenate
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import component_columns
from rpojax.scenario.schema import ScenarioFile

MOST_RUN_S = 10.0
TIMES_S = (600.0, 1000.0, 3000.0, 5900.0)
CHECKED = (
    "servicer.mass_kg",
    "thruster.force_scale",
    "camera.misalignment_deg",
    "star_tracker.misalignment_deg",
)
"""Dispersions whose effect a regression on sampled runs resolves."""


def row(found: ChannelAgreement) -> bool:
    """Prints how one component agrees; True if it does within 15 % and sampling at every time."""
    name = f"`{found.channel}` {found.component}".strip()
    cells = (
        f"{found.median:.2f}",
        f"{found.least:.2f} at {found.least_at_s:g} s",
        f"{found.largest:.2f} at {found.largest_at_s:g} s",
        f"{found.within:.0%}",
        f"{found.disagrees:.0%}",
    )
    print(f"| {name} | {' | '.join(cells)} |", flush=True)
    return found.disagrees == 0.0


def effects(file: ScenarioFile, linear: LinearCovariance, sampled: MonteCarloSample) -> None:
    """Prints what constant errors do to the along-track estimate: linear, and by regression on the drawn values."""
    engine = BatchEngine(file)
    blocks = range(0, sampled.runs, engine.runs_per_device)
    drawn = [component_columns(engine.draw_values(0, first + np.arange(engine.runs_per_device))) for first in blocks]
    values = {name: each[: sampled.runs] for name, each in concatenate(drawn).items()}
    used = {name: value for name, value in values.items() if name.split("[")[0] in CHECKED and value.std() > 0.0}
    inputs = np.stack([(value - value.mean()) / value.std() for value in used.values()], axis=1)
    along = OUTPUTS["relative_error_H"].start + 1
    print("\n| time | source | linear | by regression |\n|---|---|---|---|")
    for time_s in TIMES_S:
        error = sampled.values["relative_error_H"][np.argmin(np.abs(sampled.time_s - time_s)), :, 1]
        coefficients = np.linalg.lstsq(inputs, error - error.mean(), rcond=None)[0]
        shares = linear.shares[np.argmin(np.abs(linear.share_time_s - time_s))][:, along]
        for name in CHECKED:
            own = [each for key, each in zip(used, coefficients, strict=True) if key.split("[")[0] == name]
            expected = np.sqrt(shares[linear.sources.index(name)])
            print(f"| {time_s:g} s | `{name}` | {expected:.3f} m | {np.linalg.norm(own):.3f} m |")


def main() -> int:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    arguments = parser.parse_args()
    file = scenario_loader.load("inspection", ["camera.outlier_probability=0.0"])
    linear = covariance_propagation.propagate_covariance(file)
    print(
        f"computed in {linear.run_s:.1f} s ({linear.run_cpu_s:.1f} s of processor time), "
        f"compiled in {linear.compile_s:.1f} s"
    )
    sampled = monte_carlo_agreement.simulate_sample(file, arguments.runs, 0)
    print(f"{sampled.runs} runs simulated in {sampled.run_s:.1f} s, {sampled.failed} failed\n")
    print(f"| component | median ratio | least | largest | within {TOLERANCE:.0%} | disagrees |")
    print("|---|---|---|---|---|---|")
    held = [row(found) for found in monte_carlo_agreement.compare_with_sample(linear, sampled)]
    effects(file, linear, sampled)
    return 0 if all(held) and linear.run_s <= MOST_RUN_S else 1


if __name__ == "__main__":
    raise SystemExit(main())
