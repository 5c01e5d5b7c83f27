"""Plan of a campaign without simulating it: the dispersed values of all its runs, and the resources that it needs."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rpojax.campaign import experiment_design, resource_estimates
from rpojax.campaign.execution import batch_engine
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.core.pytree import concatenate
from rpojax.errors import RpojaxError
from rpojax.runtime import programs_per_device
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.parameter_keys import component_columns, nominal_of_key
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile

TYPICAL_SPEEDS = {"geometric": 85_000.0, "statistical": 85_000.0, "rendered": 92.0}
"""Simulated seconds of all runs per second on a core of a CPU, measured with `inspection`; by `camera.model`."""

MAX_PLAN_BYTES = 4_000_000_000
"""Memory that the values of a plan may take [B]."""


@dataclass(frozen=True)
class ResourceEstimate:
    """Rough estimate of what a campaign needs.

    Attributes:
        memory_bytes: upper estimate [B]
        disk_bytes: upper estimate [B]
        simulated_s: simulated time summed over the runs [s]
        time_s: computation time without compilation and report [s]; None if the speed is unknown
        run_seconds_per_s: speed that `time_s` is computed with
        speed_source: origin of that speed
    """

    memory_bytes: int
    disk_bytes: int
    simulated_s: float
    time_s: float | None
    run_seconds_per_s: float | None
    speed_source: str


@dataclass(frozen=True)
class Plan:
    """Runs of a campaign before they are simulated.

    Attributes:
        file: the scenario
        seed: master seed
        run_ids: (runs,) run numbers
        values: key -> (runs, ...) values that the runs will draw, in the user's units
        estimate: resources that the campaign needs
    """

    file: ScenarioFile
    seed: int
    run_ids: np.ndarray
    values: dict[str, np.ndarray]
    estimate: ResourceEstimate


def plan_campaign(
    file: ScenarioFile,
    options: CampaignOptions,
    *,
    devices: Sequence[Any] | None = None,
    speed: float | None = None,
) -> Plan:
    """Plan of the campaign with these options; `speed` in simulated seconds of all runs per second.

    The values are drawn by the compiled program that the campaign itself uses, and are equal to the last bit.

    Raises:
        RpojaxError: the speed is not positive, the design has fewer runs, or the plan does not fit into memory.
    """
    runs, first_run, seed = options.runs, options.first_run, options.seed
    if speed is not None and not 0.0 < speed < float("inf"):
        raise RpojaxError.of_argument("speed", f"found {speed}, expected simulated seconds per second, above 0")
    bytes_per_run = 8 * sum(np.size(nominal_of_key(file, key)) for key in dispersion_keys.varied_keys(file))
    if runs * bytes_per_run > MAX_PLAN_BYTES:
        raise RpojaxError.of_argument(
            "runs", f"found {runs}, expected at most {MAX_PLAN_BYTES // bytes_per_run} for a plan"
        )
    available = programs_per_device.choose_devices(devices)
    size = options.block_size or batch_engine.fitted_block_size(file, runs, len(available))
    used_devices = programs_per_device.choose_devices(available, most=-(-runs // size))
    design = experiment_design.make_design(file, seed, options.design_range)
    engine = BatchEngine(file, size, used_devices, design=design)
    blocks = [engine.draw_values(seed, first_run + begin + np.arange(size)) for begin in range(0, runs, size)]
    return Plan(
        file=file,
        seed=seed,
        run_ids=first_run + np.arange(runs),
        values={key: values[:runs] for key, values in concatenate(blocks).items()},
        estimate=_estimate_resources(file, options, size, used_devices, speed),
    )


def _estimate_resources(
    file: ScenarioFile, options: CampaignOptions, block_size: int, devices: Sequence[Any], speed: float | None
) -> ResourceEstimate:
    source, simulated_s = "given", options.runs * file.duration_s
    if speed is None:
        platform = devices[0].platform
        speed_per_core = TYPICAL_SPEEDS[file.camera.model] if platform == "cpu" else None
        if speed_per_core is None:
            source = f"none known for {platform}"
        else:
            speed = speed_per_core * len(devices) / resource_estimates.servicer_count(file)
            source = f"rough figure for {len(devices)} x CPU core"
            source += " and servicers that share nothing" if file.servicers else ""
    return ResourceEstimate(
        memory_bytes=resource_estimates.memory_bytes(file, options, block_size, len(devices)),
        disk_bytes=resource_estimates.disk_bytes(file, options, block_size, len(devices)),
        simulated_s=simulated_s,
        time_s=None if speed is None else simulated_s / speed,
        run_seconds_per_s=speed,
        speed_source=source,
    )


def csv_text(plan: Plan) -> str:
    """Table of a plan with one row per run; numbers have all digits, so that they are read back exactly."""
    columns = component_columns(plan.values)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["run_id", "seed", *columns])
    table = [values.tolist() for values in columns.values()]
    for row, run_id in enumerate(plan.run_ids.tolist()):
        writer.writerow([run_id, plan.seed, *(column[row] for column in table)])
    return stream.getvalue()


def as_json(plan: Plan) -> dict[str, Any]:
    """The plan in the types of JSON."""
    return {
        "name": plan.file.name,
        "scenario_hash": scenario_digest(plan.file),
        "design": plan.file.design.kind,
        "independent": experiment_design.has_independent_runs(plan.file),
        "seed": plan.seed,
        "runs": len(plan.run_ids),
        "run_ids": plan.run_ids.tolist(),
        "values": {key: values.tolist() for key, values in plan.values.items()},
        "estimate": asdict(plan.estimate),
        "warnings": scenario_warnings(plan.file),
    }
