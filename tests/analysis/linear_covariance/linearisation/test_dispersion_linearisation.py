"""Mean and columns of dispersions against the draws of a campaign; what has no small deviations is refused."""

import jax
import numpy as np

from rpojax.analysis.linear_covariance.linearisation import dispersion_linearisation
from rpojax.core import random_streams
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader

DRAWS = 4000
ENTRIES = (
    "dispersions=[{key='initial.relative_position_m', kind='normal', sigma=[1.0, 2.0, 3.0]}, "
    "{key='gps.noise_m', kind='uniform', low=1.0, high=4.0}, "
    "{key='servicer.mass_kg', kind='truncated_normal', sigma=0.5, limit_sigmas=1.5}, "
    "{key='thruster.force_scale', kind='log_normal', sigma=0.1}, "
    "{key='camera.mounting', kind='small_rotation', sigma_deg=0.5}, "
    "{keys=['target.mass_kg', 'thruster.position_m[1]'], kind='correlated_normal', "
    "covariance=[[4.0, 0.01], [0.01, 0.0001]]}, "
    "{key='gps.bias_sigma_m', kind='derived', offset=1.0, terms=[{key='gps.noise_m', factor=0.5}, "
    "{key='initial.relative_position_m[2]', factor=0.1}]}]"
)


def test_means_and_columns_are_those_of_the_draws() -> None:
    file = scenario_loader.load("inspection", [ENTRIES])
    found = dispersion_linearisation.linearise_dispersions(file)
    keys = jax.vmap(lambda run: random_streams.fold_in(random_streams.master_key(0), run))(np.arange(DRAWS))
    drawn = jax.jit(jax.vmap(lambda key: dispersed_values.draw(file, key, {})))(keys)
    assert set(drawn) == set(found.mean)
    names = sorted(drawn)
    samples = np.concatenate([np.asarray(drawn[name]).reshape(DRAWS, -1) for name in names], axis=1)
    mean = np.concatenate([np.ravel(found.mean[name]) for name in names])
    widths = {name: next(iter(change.values())).shape[1] for name, change in found.columns.items()}
    columns = np.concatenate(
        [
            np.concatenate([each.get(name, np.zeros((np.size(found.mean[name]), width))) for name in names])
            for each, width in zip(found.columns.values(), widths.values(), strict=True)
        ],
        axis=1,
    )
    covariance = columns @ columns.T
    sigma = np.sqrt(np.diag(covariance))
    moving = sigma > 0.0
    # Five sigma of a sampled mean and of a sampled covariance, and the second order of the rotation.
    np.testing.assert_array_less(np.abs(samples.mean(axis=0) - mean)[moving], 5.0 * sigma[moving] / DRAWS**0.5 + 2e-5)
    sampled = np.cov(samples[:, moving].T)
    scale = np.outer(sigma[moving], sigma[moving])
    np.testing.assert_array_less(np.abs(sampled - covariance[np.ix_(moving, moving)]) / scale, 7.5 / DRAWS**0.5)
    np.testing.assert_array_equal(samples[:, ~moving].std(axis=0), 0.0)


def test_an_anomaly_dispersed_over_the_circle_is_left_out() -> None:
    found = dispersion_linearisation.linearise_dispersions(scenario_loader.load("inspection"))
    assert found.left_out == ["orbit.true_anomaly_deg"]
    assert "orbit.true_anomaly_deg" not in found.mean
    assert not {"target.attitude", "target.tumble_axis", "target.tumble_rate_deg_s"} & {*found.mean, *found.left_out}
