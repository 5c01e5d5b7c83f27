"""Mean and covariance of the closed loop at every second, from nominal runs and without sampling.

The Jacobian of the loop's tick along the nominal run propagates the covariance of truth, estimate and flight software
together (Geller, "Linear covariance techniques for orbital rendezvous analysis and autonomous onboard mission
planning", Journal of Guidance, Control and Dynamics 29, 2006). Three effects that a Jacobian misses are added: burn
decisions by their describing function, the target's attitude by an ensemble of outlines, and boxes that are missed or
given up for a burn by leaving them out of the nominal run at their rate.
"""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.linear_covariance.analysis_setup import AnalysisSetup
from rpojax.analysis.linear_covariance.linearisation import dispersion_linearisation
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS
from rpojax.analysis.linear_covariance.nominal_recursion import (
    NominalRecursion,
    PeriodRecord,
    average_records,
    merge_recursions,
)
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.runtime import blas_threads
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional.registry import present_sensors

ENSEMBLE_SIZE = 256
"""Targets in the ensemble of outlines."""
MAX_HOLD_TICKS = 10
"""Most ticks that share one Jacobian once the transfer is over."""
ERRORS = {"formation error": "rho_H", "relative estimation error": "relative_error_H"}
"""Outputs of the budget by title, three axes together."""


@dataclass(frozen=True)
class LinearCovariance:
    """Mean and covariance of the outputs of the closed loop over a run.

    Attributes:
        time_s: (ticks,)
        nominal: (ticks, 19) outputs of the nominal runs, as `linearised_loop.OUTPUTS`
        mean: (ticks, 19) of all runs
        covariance: (ticks, 19, 19)
        filter_sigma_H: (ticks, 3) of the relative position in the nominal filter [m]
        box_fraction: (ticks,) fraction of the nominal runs whose filter used a box
        sources: names of the error sources
        left_out: names of dispersions whose effect is left out
        share_time_s: (spans,)
        shares: (spans, sources, 19) contribution of each source to the variances
        burn_probability: (decisions,) of a burn at each decision
        burn_size_m_s: (decisions,) mean size of its velocity change
        compile_s: compilation and initialisation [s]
        run_s: everything after it [s]
        run_cpu_s: the same, in processor time [s]
    """

    time_s: np.ndarray
    nominal: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_sigma_H: np.ndarray
    box_fraction: np.ndarray
    sources: list[str]
    left_out: list[str]
    share_time_s: np.ndarray
    shares: np.ndarray
    burn_probability: np.ndarray
    burn_size_m_s: np.ndarray
    compile_s: float
    run_s: float
    run_cpu_s: float

    def sigma(self, output: str) -> np.ndarray:
        """Standard deviations (ticks, ...) of an output."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)[:, OUTPUTS[output]])

    def output_mean(self, output: str) -> np.ndarray:
        """Means (ticks, ...) of an output."""
        return self.mean[:, OUTPUTS[output]]


def check_scenario(file: ScenarioFile) -> None:
    """Refuses scenarios with effects that have no Jacobian.

    Raises:
        RpojaxError: naming the key.
    """
    if file.camera.model != "geometric":
        raise RpojaxError(f"camera.model: found {file.camera.model!r}, expected 'geometric' for a linear covariance")
    if file.effects.faults:
        raise RpojaxError("effects.faults: found true, expected false for a linear covariance")
    if file.chamber_pressure.enabled:
        raise RpojaxError("chamber_pressure.enabled: found true, expected false for a linear covariance")
    if file.camera.distortion is not None:
        raise RpojaxError("camera.distortion: found a lens, expected a pinhole for a linear covariance")
    if file.camera.edge_noise_px == 0.0:
        raise RpojaxError("camera.edge_noise_px: found 0.0, expected more for a linear covariance")
    for name in present_sensors(file):
        raise RpojaxError(f"{name}: found a section, expected none for a linear covariance")
    dispersion_linearisation.linearise_dispersions(file)


def propagate_covariance(
    file: ScenarioFile,
    members: int = ENSEMBLE_SIZE,
    max_hold_ticks: int = MAX_HOLD_TICKS,
    stages: Stages | None = None,
) -> LinearCovariance:
    """Mean and covariance of a scenario over its duration, with an ensemble of `members` targets.

    After the transfer up to `max_hold_ticks` ticks share one Jacobian.

    Raises:
        RpojaxError: as `check_scenario`.
    """
    check_scenario(file)
    begin = time.perf_counter()
    setup = AnalysisSetup(file, members, plugin_registry.stages_of(file, stages))
    compiled = time.perf_counter()
    begin_cpu = time.process_time()
    records = _propagate_periods(setup, max_hold_ticks)
    run_s, run_cpu_s = time.perf_counter() - compiled, time.process_time() - begin_cpu
    return _join_records(setup, records, compiled - begin, run_s, run_cpu_s)


def _propagate_periods(setup: AnalysisSetup, max_hold_ticks: int) -> list[PeriodRecord]:
    """Records of all burn periods: along two nominal runs until their burns are over, then along one."""
    static = setup.loop.scenario
    records: list[PeriodRecord] = []
    # The recursion along one period overlaps with the nominal run of the next. Its matrices are small: BLAS with
    # threads of its own would take twice as long and keep the other cores from the Jacobians.
    with blas_threads.one_thread(), ThreadPoolExecutor(2) as pool:
        recursions = [
            NominalRecursion(setup, condition, max_hold_ticks, pool) for condition in setup.initial_conditions
        ]
        pending: list[list[Future[PeriodRecord]]] = []
        for first in range(0, static.ticks, static.formation_ticks):
            kept = min(static.formation_ticks, static.ticks - first)
            pending.append([recursion.advance_period(kept) for recursion in recursions])
            if len(recursions) == 2 and all(recursion.arrived for recursion in recursions):
                recursions = [merge_recursions(recursions)]
        for futures in pending:
            records.append(average_records([future.result() for future in futures]))
    return records


def _join_records(
    setup: AnalysisSetup, records: list[PeriodRecord], compile_s: float, run_s: float, run_cpu_s: float
) -> LinearCovariance:
    static = setup.loop.scenario
    time_s = np.arange(static.ticks) * static.tick_s

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(record, name) for record in records])

    decisions = np.array([record.decision for record in records])
    return LinearCovariance(
        time_s=time_s,
        nominal=joined("nominal"),
        mean=joined("mean"),
        covariance=joined("covariance"),
        filter_sigma_H=np.sqrt(joined("filter_variance_H")),
        box_fraction=joined("box_fraction"),
        sources=setup.sources,
        left_out=setup.left_out,
        share_time_s=time_s[:: setup.span_ticks],
        shares=joined("shares"),
        burn_probability=decisions[:, 0],
        burn_size_m_s=decisions[:, 1],
        compile_s=compile_s,
        run_s=run_s,
        run_cpu_s=run_cpu_s,
    )


@dataclass(frozen=True)
class ErrorBudget:
    """Standard deviations [m] of the three axes together, by error and source.

    Attributes:
        at_end: by each source alone, at the end
        total_at_end: by all sources
        at_worst: greatest by each source alone
        worst_at_s: time of it [s]
    """

    at_end: dict[str, dict[str, float]]
    total_at_end: dict[str, float]
    at_worst: dict[str, dict[str, float]]
    worst_at_s: dict[str, dict[str, float]]


def error_budget(linear: LinearCovariance) -> ErrorBudget:
    """Error budget of a linear covariance."""
    at_end, total, at_worst, worst_at = {}, {}, {}, {}
    for title, output in ERRORS.items():
        # Rounding can leave a share of zero slightly negative.
        sigma = np.sqrt(np.maximum(linear.shares[:, :, OUTPUTS[output]].sum(axis=2), 0.0))
        at_end[title] = dict(zip(linear.sources, sigma[-1].tolist(), strict=True))
        total[title] = float(np.sqrt(np.sum(sigma[-1] ** 2)))
        at_worst[title] = dict(zip(linear.sources, sigma.max(axis=0).tolist(), strict=True))
        when = linear.share_time_s[sigma.argmax(axis=0)]
        worst_at[title] = dict(zip(linear.sources, when.tolist(), strict=True))
    return ErrorBudget(at_end, total, at_worst, worst_at)
