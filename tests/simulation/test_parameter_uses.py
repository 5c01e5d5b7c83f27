"""The table of key uses against the programs: which parameters does one read, and which change nothing in it?"""

import functools
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.interpreters import partial_eval

import rpojax
from rpojax.campaign.execution.run_programs import run_program
from rpojax.errors import ScenarioError
from rpojax.flight.stages import Stages
from rpojax.metrics.metric_catalogue import DIFFERENTIABLE, METRICS
from rpojax.scenario import metric_needs
from rpojax.scenario.params import Params, get_leaf, leaf_path_and_factor, replace_leaf
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team.members import member_files
from rpojax.scenario.warnings.key_uses import Situation, unused_keys
from rpojax.simulation.metrics import running_metrics
from rpojax.simulation.step import step

TICKS = 3
"""More add nothing: what a tick reads of the state before is followed through the loop."""
ELSEWHERE = {
    "limits.lost_after_s", "limits.off_station_m", "limits.arrive_by_s",
    "imaging.exposure", "imaging.full_well", "imaging.read_noise", "imaging.blur_px", "imaging.score_threshold",
    "team.keep_out_m",
}  # fmt: skip
"""Parameters that have an effect outside of the loop: those of the judgement of runs, those for which the statistics of
a camera must have been fitted, and one that stands for none where it is 0."""
WITHOUT_EFFECT = {
    "imaging.center_sigma_m",
    "camera.outlier_size_min_px", "camera.outlier_size_max_px",
    "gps.bias_time_constant_s",
    "landmarks.swap_probability",
    "target.tumble_axis",
    "plume.inhibit_angle_deg",
    "faults.fault.start_s", "faults.fault.duration_s", "faults.fault.severity", "faults.fault.wheel",
    "wheels.stiction_speed_rad_s",
    "navigation.thrust_sigma", "formation.thruster_retry_s",
    "navigation.gate_sigma", "health.contradiction_limit",
    "navigation.recovery_after_s", "navigation.recovery_position_sigma", "navigation.recovery_velocity_sigma_m_s",
    "navigation.difference_range_bias_sigma_m",
    "link.burst_loss", "link.burst_duration_s",
    "mission.hold_at_s", "mission.resume_at_s", "mission.abort_at_s",
}  # fmt: skip
"""Parameters that a program reads and that change nothing: they meet a zero, or a condition that never holds."""
VARIANTS = {
    "inspection": ("inspection", []),
    "full": ("inspection_full", []),
    "drag": ("inspection", ["effects.drag=true"]),
    "light": ("inspection", ["effects.solar_pressure=true"]),
    "faults": ("inspection_faults", []),
    "faults without a sensor for them": ("inspection_faults", ["chamber_pressure.enabled=false"]),
    "an outage": ("inspection", ["effects.faults=true", "faults.fault.kind=gps_outage"]),
    "chamber pressure": ("inspection", ["chamber_pressure.enabled=true"]),
    "landmarks": ("pose_inspection", []),
    "landmarks in pictures": ("pose_inspection", ["camera.model=rendered"]),
    "port": ("capture", []),
    "statistics": ("inspection", ["camera.model=statistical"]),
    "pictures": ("inspection", ["camera.model=rendered"]),
    "no gate": ("inspection", ["navigation.gating=none"]),
    "ellipse": ("safety_ellipse", []),
    "fly-around": ("fly_around", []),
    "approach": ("vbar_approach", []),
    "plume": ("final_approach", []),
    "aborts": ("inspection_abort", []),
    "eccentric": ("elliptic_rendezvous", []),
    "team": ("cooperative_inspection", []),
    "team without messages": ("cooperative_inspection", ["navigation.sharing=none", "team.keep_out_m=0"]),
    "team with code": ("cooperative_inspection", ["gps_differences.kind=code"]),
    "team with estimates": ("cooperative_inspection", ["navigation.sharing=estimates"]),
    "team, central": ("cooperative_inspection", ["navigation.sharing=central", "link_range.enabled=true"]),
    "team, naive": ("cooperative_inspection", ["navigation.sharing=naive"]),
    "team with ranges": ("cooperative_inspection", ["link_range.enabled=true"]),
    "team without a gate": ("cooperative_inspection", ["navigation.gating=none"]),
    "team, spread": ("cooperative_inspection", ["team.phasing=spread", "team.keep_out_m=0"]),
    "team, viewpoints": ("cooperative_inspection", ["team.phasing=viewpoints"]),
    "team with faults": ("cooperative_faults", []),
}


def keys_with_leaves(file: ScenarioFile, params: Params) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Keys of the parameters of a scenario, with the path of each."""

    def keys(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
        for name, value in table.items():
            if isinstance(value, dict):
                yield from keys(value, f"{prefix}{name}.")
            else:
                yield f"{prefix}{name}"

    tables = file.model_dump()
    if not file.phases:  # a station has no keys for the commands and aborts of a mission
        del tables["mission"]
    every = [*keys({name: table for name, table in tables.items() if isinstance(table, dict)}, "")]
    for phase in tables["phases"]:
        every += keys(phase, f"phases.{phase['name']}.")
    for key in every:
        try:
            path, _ = leaf_path_and_factor(key)
            leaf = get_leaf(params, path)
        except (ScenarioError, AttributeError):
            continue
        if leaf is not None and hasattr(leaf, "shape"):
            yield key, path


def unread(file: ScenarioFile) -> tuple[set[str], set[str]]:
    """Keys of all parameters, and of those that neither channels nor metrics of a run depend on."""
    file = file.model_copy(update={"dispersions": []})
    scenario = static_settings(file, allow_team=True)
    run: Any = run_program(file, scenario, Stages(), "jax")
    leaves, tree = jax.tree.flatten(run.nominal)
    metrics = [METRICS[name] for name in DIFFERENTIABLE if metric_needs.lacks(file, METRICS[name]) is None]
    key = jax.random.key_data(jax.random.key(0))
    nothing: Any = [{} for _ in file.servicers] or {}

    def simulate(leaves: list[Any]) -> Any:
        params = jax.tree.unflatten(tree, leaves)
        _, _, first = run.prepare(params, nothing, key, {}, single=False)

        def body(carry: Any, _: None) -> tuple[Any, Any]:
            state, sums = carry
            after, channels = run.tick(params, {}, state)
            if not file.servicers:
                telemetry = step(scenario, params, state)[1]
                sums = running_metrics.add_tick(metrics, scenario, params, telemetry, sums)
            return (after, sums), channels

        start = (first, running_metrics.initial_sums(metrics))
        (end, sums), channels = jax.lax.scan(body, start, None, length=TICKS)
        end = end.servicers if file.servicers else end
        return channels, sums, end.failure, end.failed_at

    program = jax.make_jaxpr(simulate)(leaves).jaxpr
    _, is_read = partial_eval.dce_jaxpr(program, [True] * len(program.outvars))
    numbers = jax.tree.unflatten(tree, range(len(leaves)))
    paths = dict(keys_with_leaves(member_files(file)[0], run.nominal))
    return set(paths), {key for key, path in paths.items() if not is_read[get_leaf(numbers, path)]}


@pytest.mark.parametrize(
    "name", [name if name == "inspection" else pytest.param(name, marks=pytest.mark.slow) for name in VARIANTS]
)
def test_a_program_reads_the_parameters_that_have_an_effect(name: str) -> None:
    source, overrides = VARIANTS[name]
    file = rpojax.load(source, overrides)
    declared = [unused_keys(Situation(member, bool(file.servicers))) for member in member_files(file)]
    of_all = {key for key in declared[0] if all(key in others for others in declared)}
    parameters, without = unread(file)
    assert without - ELSEWHERE - of_all == set()
    assert (of_all & parameters) - WITHOUT_EFFECT - without - {k for k in of_all if k.startswith("phases.")} == set()


IDLE = {
    "no gate": (
        "inspection",
        [
            "navigation.gating=none",
            "effects.faults=true",
            "faults.fault.kind=gps_outage",
            "faults.fault.start_s=100",
            "faults.fault.duration_s=50",
            "camera.outlier_probability=0",
            "gps.bias_sigma_m=0",
            "target.tumble_rate_deg_s=0",
        ],
        ("faults.fault.start_s", "faults.fault.duration_s"),
    ),
    "no faults": ("inspection", ["effects.faults=true"], ()),
    "phases": (
        "vbar_approach",
        [
            "phases.hold_100.reference={kind='relative_orbit', along_track_m=-100.0}",
            "phases.hold_100.pointing=sun_safe",
        ],
        (),
    ),
}
"""Scenarios in which parameters change nothing though they are read, and those of `WITHOUT_EFFECT` that do."""


@pytest.mark.slow
@pytest.mark.parametrize("name", IDLE)
def test_a_parameter_without_effect_changes_no_bit(name: str) -> None:
    source, overrides, used = IDLE[name]
    file = rpojax.load(source, [*overrides, "dispersions=[]"])
    declared = unused_keys(Situation(file, False))
    run: Any = run_program(file, static_settings(file), Stages(), "jax")
    key = jax.random.key_data(jax.random.key(1))

    @jax.jit
    def simulate(params: Params) -> Any:
        _, _, state = run.prepare(params, {}, key, {}, single=False)
        return jax.lax.scan(lambda state, _: run.tick(params, {}, state), state, None, length=500)[1]

    paths = dict(keys_with_leaves(file, run.nominal))
    idle = [key for key in declared if key in paths]
    assert not set(idle) & set(used)
    expected = simulate(run.nominal)
    for changed in [*idle, *used]:
        leaf = jnp.asarray(get_leaf(run.nominal, paths[changed]))
        params = replace_leaf(run.nominal, paths[changed], functools.reduce(jnp.add, [leaf, 0.25 * leaf, 0.01]))
        found = simulate(params)
        differing = {
            channel for channel in found if not np.array_equal(found[channel], expected[channel], equal_nan=True)
        }
        # The window of the gate is drawn whether boxes must pass it or not.
        assert bool(differing - {"gate_px"}) == (changed in used), changed
