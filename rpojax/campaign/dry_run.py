"""What a campaign would fly: the values of all its runs, drawn by the program that the campaign draws them with."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import numpy as np

from rpojax.campaign import preflight
from rpojax.campaign.execution import batch_engine
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.dispersions import designs
from rpojax.dispersions.designs import RunRange
from rpojax.errors import RpojaxError
from rpojax.scenario import dispersion_keys, scenario_file, schema
from rpojax.scenario.schema import ScenarioFile

TYPICAL_SPEEDS = {"geometric": 85_000.0, "statistical": 85_000.0, "rendered": 92.0}
"""Simulated seconds of all runs per second on a core of a CPU, measured with `inspection`; by `camera.model`."""


MAX_PLAN_BYTES = 4_000_000_000
"""Memory that the values of a plan may take [B]."""


@dataclass(frozen=True)
class ResourceEstimate:
    """What a campaign would take, by a rough count.

    Attributes:
        memory_bytes: at most [B]
        disk_bytes: at most [B]
        simulated_s: duration of all runs, one after the other [s]
        time_s: of flying, compilation and report left out [s]; None where no speed is known
        run_seconds_per_s: speed that the time is worked out with
        speed_source: where that speed comes from
    """

    memory_bytes: int
    disk_bytes: int
    simulated_s: float
    time_s: float | None
    run_seconds_per_s: float | None
    speed_source: str


@dataclass(frozen=True)
class Plan:
    """Runs of a campaign before they fly.

    Attributes:
        file: the scenario
        seed: of all runs
        run_ids: (runs,) numbers
        values: key -> (runs, ...) values that the runs will draw, in the user's units
        estimate: what it would take
    """

    file: ScenarioFile
    seed: int
    run_ids: np.ndarray
    values: dict[str, np.ndarray]
    estimate: ResourceEstimate


def plan_campaign(
    file: ScenarioFile,
    runs: int,
    seed: int = 0,
    *,
    first_run: int = 0,
    block_size: int | None = None,
    history_count: int = 0,
    devices: Sequence[Any] | None = None,
    speed: float | None = None,
) -> Plan:
    """Plan of the campaign of the same arguments; `speed` in simulated seconds of all runs per second.

    Raises:
        RpojaxError: a number is out of range, the design has fewer runs, or the plan does not fit into memory.
    """
    preflight.check_numbers(runs, first_run, seed, block_size)
    if speed is not None and not 0.0 < speed < float("inf"):
        raise RpojaxError(f"--speed: found {speed}, expected simulated seconds per second, above 0")
    bytes_per_run = 8 * sum(np.size(schema.nominal_value(file, key)) for key in dispersion_keys.varied_keys(file))
    if runs * bytes_per_run > MAX_PLAN_BYTES:
        raise RpojaxError(f"--runs: found {runs}, expected at most {MAX_PLAN_BYTES // bytes_per_run} for a plan")
    size = block_size or batch_engine.default_block_size(file)
    used = list(jax.devices() if devices is None else devices)[: -(-runs // size)]
    population = RunRange(first_run, runs)
    machine = BatchEngine(file, size, used, design=designs.make_design(file, seed, population))
    blocks = [machine.draw_values(seed, first_run + begin + np.arange(size)) for begin in range(0, runs, size)]
    return Plan(
        file=file,
        seed=seed,
        run_ids=first_run + np.arange(runs),
        values={key: np.concatenate([block[key] for block in blocks])[:runs] for key in sorted(blocks[0])},
        estimate=_estimate_resources(file, runs, size, used, history_count, speed),
    )


def _estimate_resources(
    file: ScenarioFile, runs: int, size: int, devices: Sequence[Any], histories: int, speed: float | None
) -> ResourceEstimate:
    source, simulated_s = "given", runs * file.duration_s
    if speed is None:
        kind = devices[0].platform
        rough = TYPICAL_SPEEDS[file.camera.model] if kind == "cpu" else None
        speed = None if rough is None else rough * len(devices)
        source = f"none known for {kind}" if rough is None else f"rough figure for {len(devices)} x CPU core"
    return ResourceEstimate(
        memory_bytes=preflight.memory_bytes(file, runs, size, len(devices), histories),
        disk_bytes=preflight.disk_bytes(file, runs, histories),
        simulated_s=simulated_s,
        time_s=None if speed is None else simulated_s / speed,
        run_seconds_per_s=speed,
        speed_source=source,
    )


def csv_text(plan: Plan) -> str:
    """Table of a plan, one row a run; numbers have all digits that they need to be read back as they were."""
    found = dispersion_keys.component_columns(plan.values)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["run_id", "seed", *found])
    table = [values.tolist() for values in found.values()]
    for row, run_id in enumerate(plan.run_ids.tolist()):
        writer.writerow([run_id, plan.seed, *(column[row] for column in table)])
    return stream.getvalue()


def as_json(plan: Plan) -> dict[str, Any]:
    """The plan for machines."""
    return {
        "name": plan.file.name,
        "scenario_hash": scenario_file.digest(plan.file),
        "design": plan.file.design.kind,
        "independent": designs.has_independent_runs(plan.file),
        "seed": plan.seed,
        "runs": len(plan.run_ids),
        "run_ids": plan.run_ids.tolist(),
        "values": {key: values.tolist() for key, values in plan.values.items()},
        "estimate": asdict(plan.estimate),
    }
