"""Tick of a team: servicers that share nothing fly as if alone, and one trace serves all values."""

from collections.abc import Sequence

import jax
import numpy as np
import pytest
from named_loops import name_loop

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team.members import member_params
from rpojax.simulation.noise import run_key
from rpojax.simulation.team import initial_team, member_axes, team_step

OVERRIDES = ["duration_s=200"]
ROUNDING = {"rtol": 1e-5, "atol": 1e-5}
"""Another program rounds differently; over 200 s the differences stay below single precision."""
TEAM = """
extends = "inspection"
name = "pair"
description = "Two servicers."

[[servicers]]
name = "first"

[[servicers]]
name = "second"
initial = { relative_position_m = [0.0, 45.0, 0.0] }
formation = { desired_position_m = [0.0, 30.0, 0.0] }
"""


@pytest.fixture(scope="module")
def pair(programs: None, tmp_path_factory: pytest.TempPathFactory) -> ScenarioFile:
    """Two servicers on either side of the target."""
    path = tmp_path_factory.mktemp("team") / "pair.toml"
    path.write_text(TEAM)
    return name_loop("pair", scenario_loader.load(str(path), OVERRIDES))


def simulate(file: ScenarioFile, ids: Sequence[int]) -> dict[str, np.ndarray]:
    """Channels (ticks, runs, ...) of some runs."""
    # One after the other: the program of a servicer alone is that of the campaigns.
    engine = BatchEngine(file, 1, jax.devices()[:1])
    runs = [[segment.channels for segment in engine.simulate(engine.prepare(3, np.array([one])))] for one in ids]
    each = [{name: np.concatenate([part[name] for part in parts]) for name in parts[0]} for parts in runs]
    return {name: np.concatenate([run[name] for run in each], axis=1) for name in each[0]}


def test_servicers_that_share_nothing_do_as_alone(pair: ScenarioFile) -> None:
    together = simulate(pair, [4, 5])
    alone = simulate(scenario_loader.load("inspection", OVERRIDES), [4, 5])
    for name, values in alone.items():
        np.testing.assert_allclose(together[name][..., 0], values, **ROUNDING, err_msg=name)
    # The second one starts on the other side, by random numbers of its own, around the same target.
    np.testing.assert_allclose(together["rho_H"][0, :, 1, 1], 45.0, atol=5.0)
    assert np.all(
        np.abs(together["relative_error_H"][0, ..., 1] - together["relative_error_H"][0, ..., 0]).max(-1) > 1e-3
    )


def test_decisions_of_the_second_servicer_are_staggered(pair: ScenarioFile) -> None:
    found = simulate(pair.model_copy(update={"duration_s": 400.0}), [4, 5])
    applied = np.diff(found["delta_v_m_s"][:, 0], axis=0) > 0.0
    first, second = applied.argmax(axis=0)
    assert applied.any(axis=0).all()
    assert 80 < (second - first) % 200 < 120


@pytest.mark.slow
def test_all_servicers_decide_though_their_clocks_coincide(pair: ScenarioFile) -> None:
    changes = {"servicers": [each.model_copy(update={"decision_offset_s": 0.0}) for each in pair.servicers]}
    found = simulate(pair.model_copy(update={"duration_s": 400.0, **changes}), [4])
    applied = np.diff(found["delta_v_m_s"][:, 0], axis=0) > 0.0
    assert applied.any(axis=0).all()
    assert abs(int(applied[:, 1].argmax()) - int(applied[:, 0].argmax())) < 20


NEAR = [
    "duration_s=3000",
    "servicers.second.phases.inspect.reference.radial_phase_deg=20",
    "servicers.second.phases.inspect.reference.cross_track_phase_deg=20",
]
"""The second servicer is sent to a place 6 m from the first one's."""


@pytest.mark.slow
def test_servicers_that_are_sent_near_to_each_other_keep_clear() -> None:
    found = simulate(scenario_loader.load("cooperative_inspection", NEAR), range(4))
    between = np.linalg.norm(found["rho_H"][..., 0].astype(float) - found["rho_H"][..., 1], axis=2)
    assert between.min() > 10.0
    assert np.all((found["burn_changed_for"] > 0).any(axis=(0, 2)))
    unaware = simulate(scenario_loader.load("cooperative_inspection", [*NEAR, "team.keep_out_m=0"]), range(4))
    between = np.linalg.norm(unaware["rho_H"][..., 0].astype(float) - unaware["rho_H"][..., 1], axis=2)
    assert between.min() < 8.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sharing", "phasing"), [("boxes", "fixed"), ("estimates", "spread"), ("boxes", "viewpoints"), ("naive", "fixed")]
)
def test_a_tick_of_servicers_that_share_has_the_shapes_and_types_of_the_state_before(
    sharing: str, phasing: str
) -> None:
    overrides = [f"navigation.sharing={sharing}", f"team.phasing={phasing}"]
    file = scenario_loader.load("cooperative_inspection", overrides)
    scenario = static_settings(file, allow_team=True)
    team = member_axes.stack_members(member_params(file))
    state = jax.eval_shape(lambda: initial_team.init(scenario, team, run_key(1, 0)))
    after, seen = jax.eval_shape(lambda before: team_step.step(scenario, team, before), state)
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), after) == jax.tree.map(
        lambda leaf: (leaf.shape, leaf.dtype), state
    )
    assert seen.truth.r_ST_N.shape == (3, 3)


SILENT = [
    "duration_s=1500",
    "team.phasing=spread",
    "effects.faults=true",
    "faults.fault.kind=none",
    "servicers.second.faults.fault.kind=radio_off",
    "servicers.second.faults.fault.start_s=300",
    "servicers.second.faults.fault.duration_s=100000",
]


@pytest.mark.slow
def test_a_servicer_that_falls_silent_is_left_out_and_the_phases_are_spread_anew() -> None:
    found = simulate(scenario_loader.load("cooperative_inspection", SILENT), range(2))
    assert np.all(found["known_members"][290] == 3)
    # The others know of two, the silent one of itself alone; no decision comes later than 200 s after a minute.
    np.testing.assert_array_equal(found["known_members"][-1], [[2, 1, 2]] * 2)
    assert np.all(found["phase_shift_deg"][:300] == 0.0)
    first, second, third = found["phase_shift_deg"][-1].T
    assert np.all((first < -10.0) & (second == 0.0) & (third > 10.0))
