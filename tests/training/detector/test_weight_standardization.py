"""Standardised kernels and their gains."""

import jax
import numpy as np
import pytest

from rpojax.training import training_steps
from rpojax.vision.detector.proposal_network import initialize

apply_channel_gains = jax.jit(training_steps.apply_channel_gains)
with_channel_gains = jax.jit(training_steps.with_channel_gains)


def test_standardized_kernels_have_zero_mean_and_norm_of_gain() -> None:
    params = initialize(jax.random.key(0))
    trained = with_channel_gains(params)
    trained["down1"]["gain"] = trained["down1"]["gain"].at[3].set(0.25)
    kernel = apply_channel_gains(trained)["down1"]["kernel"]
    np.testing.assert_allclose(kernel.mean(axis=(0, 1, 2)), 0.0, atol=1e-6)
    lengths = np.sqrt((np.asarray(kernel) ** 2).sum(axis=(0, 1, 2)))
    before = np.asarray(params["down1"]["kernel"])
    before = np.sqrt(((before - before.mean(axis=(0, 1, 2))) ** 2).sum(axis=(0, 1, 2)))
    np.testing.assert_allclose(np.delete(lengths, 3), np.delete(before, 3), rtol=1e-5)
    assert lengths[3] == pytest.approx(0.25, rel=1e-5)
    np.testing.assert_array_equal(apply_channel_gains(trained)["out"]["kernel"], trained["out"]["kernel"])
    # Standardising twice changes nothing.
    again = apply_channel_gains(with_channel_gains(apply_channel_gains(trained)))
    np.testing.assert_allclose(again["same1"]["kernel"], apply_channel_gains(trained)["same1"]["kernel"], atol=1e-6)
