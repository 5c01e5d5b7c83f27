"""Linear covariance analysis of a scenario: mean, spread and error budget of its runs, without sampling them."""

import dataclasses
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.analysis.linear_covariance import monte_carlo_agreement
from rpojax.analysis.linear_covariance.covariance_propagation import (
    ENSEMBLE_SIZE,
    ErrorBudget,
    LinearCovariance,
    check_scenario,
    error_budget,
    propagate_covariance,
)
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS
from rpojax.analysis.linear_covariance.monte_carlo_agreement import CHANNELS, ChannelAgreement, MonteCarloSample
from rpojax.campaign import argument_checks
from rpojax.campaign.storage.atomic_outputs import check_replaceable, to_json_types, write_atomically, write_json
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import stage
from rpojax.scenario.schema import ScenarioFile

if TYPE_CHECKING:
    import xarray

RECORD_NAME, ARRAYS_NAME = "lincov.json", "lincov.npz"
_MIN_RUNS = 10
_ARRAYS = ("rho_H", "rho_dot_H", "relative_error_H", "relative_rate_error_H", "servicer_error_H", "delta_v_m_s")

_VELOCITIES = ("rho_dot_H", "relative_rate_error_H", "delta_v_m_s")
"""Those of them in m/s; the others are in m."""


@dataclass(frozen=True)
class LinearCovarianceAnalysis:
    """Linear covariance of a scenario, its error budget, and its agreement with sampled runs.

    Attributes:
        file: the scenario
        members: targets in the ensemble of outlines
        seed: of the sampled runs
        covariance: mean and covariance over a run
        budget: contributions of the error sources
        sample: sampled runs; None if no runs were sampled
        agreement: of every compared component with the sampled runs
    """

    file: ScenarioFile
    members: int
    seed: int
    covariance: LinearCovariance
    budget: ErrorBudget
    sample: MonteCarloSample | None
    agreement: tuple[ChannelAgreement, ...]

    @property
    def warnings(self) -> list[str]:
        """Dispersions that are left out, and components that disagree with the sampled runs."""
        left_out = [f"{name}: its spread is too large for a derivative; left out" for name in self.covariance.left_out]
        return left_out + [
            f"{row.channel} {row.component}".strip()
            + f": off by more than 15 % and sampling together at {row.disagrees:.0%} of the times, "
            f"ratio {row.least:.2f} at {row.least_at_s:g} s to {row.largest:.2f} at {row.largest_at_s:g} s; "
            "the loop is not linear there"
            for row in self.agreement
            if row.disagrees > 0.0
        ]

    def to_dict(self) -> dict[str, Any]:
        """Content of lincov.json, in the types of JSON."""
        found, sample = self.covariance, self.sample
        content = {
            "scenario": self.file.name,
            "settings": {
                "duration_s": self.file.duration_s,
                "members": self.members,
                "runs": None if sample is None else sample.runs,
                "failed_runs": None if sample is None else sample.failed,
                "seed": self.seed,
            },
            "compile_s": found.compile_s,
            "run_s": found.run_s,
            "run_cpu_s": found.run_cpu_s,
            "sampling_s": None if sample is None else sample.run_s,
            "at_end": {
                name: {"mean": found.output_mean(name)[-1].tolist(), "sigma": found.sigma(name)[-1].tolist()}
                for name in CHANNELS
            },
            "left_out": found.left_out,
            "burn_probability": found.burn_probability.tolist(),
            "budget": dataclasses.asdict(self.budget),
            "agreement": [dataclasses.asdict(row) for row in self.agreement],
            "warnings": self.warnings,
        }
        return to_json_types(content)

    def arrays(self) -> dict[str, np.ndarray]:
        """Content of lincov.npz: time histories, time first."""
        found = self.covariance
        # Six of truth, six of the error of the estimate.
        rows = slice(0, OUTPUTS["servicer_error_H"].start)
        return {
            "time_s": found.time_s,
            **{name: found.output_mean(name) for name in _ARRAYS},
            **{f"{name}_sigma": found.sigma(name) for name in _ARRAYS},
            "covariance": found.covariance[:, rows, rows],
            "filter_sigma_H": found.filter_sigma_H,
            "sources": np.array(found.sources),
            "share_time_s": found.share_time_s,
            "shares": found.shares,
        }

    def to_xarray(self) -> "xarray.Dataset":
        """Mean and sigma of every output over `time` [s], and the filter's own sigma, as a dataset with units.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        labelled, arrays = require_package("xarray"), self.arrays()
        names = [*(name + suffix for name in _ARRAYS for suffix in ("", "_sigma")), "filter_sigma_H"]
        variables = {
            name: (("time", f"axis_{name}")[: arrays[name].ndim], arrays[name], {"units": _unit(name)})
            for name in names
        }
        return labelled.Dataset(
            variables, {"time": ("time", arrays["time_s"], {"units": "s"})}, {"name": self.file.name}
        )

    def write(self, directory: Path | str, force: bool = False) -> None:
        """Writes lincov.npz and lincov.json into a folder.

        Raises:
            OutputError: a file exists and is not to be replaced by `force`, or cannot be written.
        """
        directory = Path(directory)
        check_replaceable((directory / RECORD_NAME, directory / ARRAYS_NAME), force)
        stream = io.BytesIO()
        np.savez_compressed(stream, allow_pickle=False, **self.arrays())
        write_atomically(directory / ARRAYS_NAME, stream.getvalue())
        write_json(directory / RECORD_NAME, self.to_dict())


def linear_covariance(
    file: ScenarioFile,
    *,
    members: int = ENSEMBLE_SIZE,
    runs: int = 0,
    seed: int = 0,
    stages: Stages | None = None,
    progress: bool = True,
) -> LinearCovarianceAnalysis:
    """Mean, covariance and error budget of a scenario's runs by linear covariance, without sampling.

    Args:
        file: scenario with the geometric camera and without faults
        members: tumbling targets in the ensemble of outlines
        runs: to simulate for comparison, at least 10; 0 for none
        seed: master seed of these runs
        stages: of the flight software, replaced ones included
        progress: show progress on stderr

    Raises:
        RpojaxError: a number is out of range, or an effect of the scenario has no Jacobian.
    """
    if runs != 0 and runs < _MIN_RUNS:
        raise RpojaxError.of_argument("runs", f"found {runs}, expected 0 or at least {_MIN_RUNS}")
    if members < 2:
        raise RpojaxError.of_argument("members", f"found {members}, expected at least 2")
    argument_checks.check_numbers(max(runs, 1), 0, seed, None)
    check_scenario(file)
    with stage("linear covariance: compiling, then propagating", quiet=not progress):
        found = propagate_covariance(file, members, stages=stages)
    sample, agreement = None, ()
    if runs:
        with stage(f"simulating {runs} runs", quiet=not progress):
            sample = monte_carlo_agreement.simulate_sample(file, runs, seed, stages)
        agreement = tuple(monte_carlo_agreement.compare_with_sample(found, sample))
    return LinearCovarianceAnalysis(file, members, seed, found, error_budget(found), sample, agreement)


def _unit(name: str) -> str:
    return "m/s" if name.removesuffix("_sigma") in _VELOCITIES else "m"
