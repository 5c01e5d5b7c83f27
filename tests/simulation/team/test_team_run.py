"""Tick of a team: servicers that share nothing fly as if alone, and one trace serves all values."""

from collections.abc import Sequence

import jax
import numpy as np
import pytest

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

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
def pair(tmp_path_factory: pytest.TempPathFactory) -> ScenarioFile:
    """Two servicers on either side of the target."""
    path = tmp_path_factory.mktemp("team") / "pair.toml"
    path.write_text(TEAM)
    return scenario_loader.load(str(path), OVERRIDES)


def simulate(file: ScenarioFile, ids: Sequence[int]) -> dict[str, np.ndarray]:
    """Channels (ticks, runs, ...) of some runs."""
    engine = BatchEngine(file, len(ids), jax.devices()[:1])
    segments = list(engine.simulate(engine.prepare(3, np.asarray(ids))))
    return {name: np.concatenate([segment.channels[name] for segment in segments]) for name in segments[0].channels}


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
    found = simulate(pair.model_copy(update={"duration_s": 400.0}), [4])
    applied = np.diff(found["delta_v_m_s"][:, 0], axis=0) > 0.0
    first, second = applied.argmax(axis=0)
    assert applied.any(axis=0).all()
    assert 80 < (second - first) % 200 < 120


def test_all_servicers_decide_though_their_clocks_coincide(pair: ScenarioFile) -> None:
    changes = {"servicers": [each.model_copy(update={"decision_offset_s": 0.0}) for each in pair.servicers]}
    found = simulate(pair.model_copy(update={"duration_s": 400.0, **changes}), [4])
    applied = np.diff(found["delta_v_m_s"][:, 0], axis=0) > 0.0
    assert applied.any(axis=0).all()
    assert abs(int(applied[:, 1].argmax()) - int(applied[:, 0].argmax())) < 20
