"""Initial deviations of a linear covariance: the hand-over error is the true one, the filter's covariance as told."""

import jax
import numpy as np

from rpojax.analysis.linear_covariance.linearisation import dispersion_linearisation
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import HANDOVER, make_layout
from rpojax.core.frames import hill_frame
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key

SIGMA_H = (3.0, 10.0, 0.5)


def test_the_hand_over_error_is_the_true_one_and_the_filter_keeps_what_it_is_told() -> None:
    override = f"initial.handover.relative_position_sigma_m={list(SIGMA_H)}"
    file = scenario_loader.load("inspection", ["dispersions=[]", override])
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    key = run_key(0, 0)
    layout = make_layout(jax.eval_shape(lambda: initial_state.init(static, nominal, key)), nominal, ())
    found = dispersion_linearisation.linearise_dispersions(file)
    start = dispersion_linearisation.initial_conditions(static, nominal, layout, key, found)[0]
    R_HN = np.asarray(hill_frame(start.state.truth.r_TN_N, start.state.truth.v_TN_N)[0])
    columns = R_HN @ start.columns[HANDOVER][layout.slices["flight.orbit.relative.r_TS_N"]]
    np.testing.assert_allclose(columns @ columns.T, np.diag(np.square(SIGMA_H)), atol=1e-9)
    told = file.navigation.initial_relative_position_sigma_m**2
    np.testing.assert_allclose(start.state.flight.orbit.relative.covariance[:3, :3], told * np.eye(3), atol=1e-12)
