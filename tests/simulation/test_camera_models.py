"""Camera models in the closed loop."""

from collections.abc import Sequence

import jax
import numpy as np
import pytest

from rpojax.flight.stages import Stages
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation import initial_state
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.step import step

SMALL = ["camera.width_px=64", "camera.height_px=64", "camera.field_of_view_deg=5.0", "dispersions=[]"]
POINTED = "navigation.initial_relative_position_sigma_m=0.2"
TICKS = 12


def simulate(overrides: Sequence[str]) -> Channels:
    """Channels of the first ticks of a run."""
    file = scenario_loader.load("inspection", overrides)
    static = static_settings(file)
    parameters = params.build_params(file.model_dump(), static.width_px, static.height_px)
    state = initial_state.init(static, parameters, run_key(0, 0))

    @jax.jit
    def run(parameters: params.Params, state: State) -> Channels:
        def one(state: State, _: None) -> tuple[State, Channels]:
            after, telemetry = step(static, parameters, state, Stages())
            return after, compute_channels(static, parameters, telemetry)

        return jax.lax.scan(one, state, None, length=TICKS)[1]

    return jax.tree.map(np.asarray, run(parameters, state))


@pytest.fixture(scope="module")
def rendered() -> Channels:
    """Channels of a run with the rendered camera."""
    return simulate([*SMALL, POINTED, "camera.model=rendered", "initial.relative_position_m=[0.0, -30.0, 0.0]"])


def test_detected_boxes_are_of_the_target(rendered: Channels) -> None:
    assert rendered["observable"].all()
    present = rendered["box_present"]
    assert present.mean() > 0.8
    assert not rendered["box_outlier"].any()
    # 1.6 m at 30 m with a focal length of 733 px are at most 39 px; the box of a tumbling target is about half of that.
    sides = rendered["box_px"][present][:, 2:]
    assert 8.0 < np.median(np.sqrt(np.prod(sides, axis=1))) < 40.0


def test_detected_boxes_are_accepted_and_bound_the_error(rendered: Channels) -> None:
    assert rendered["box_accepted"].mean() > 0.6
    assert np.linalg.norm(rendered["relative_error_H"], axis=1).max() < 10.0
