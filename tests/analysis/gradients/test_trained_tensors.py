"""Tensors of the packaged networks by the names of their files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.gradients import trained_tensors
from rpojax.sensors.rendered_camera import Networks
from rpojax.vision.detector.detector_file import load_detector, packaged_detector_path
from rpojax.vision.imaging.random_sky import random_sky
from rpojax.vision.radiance_field.field_file import load_field, packaged_field_path
from rpojax.vision.weight_files import read_tensors


@pytest.fixture(scope="module")
def networks() -> Networks:
    """The packaged networks."""
    return Networks(field=load_field()[0], detector=load_detector()[0], sky=random_sky(0))


def test_names_and_values_are_those_of_the_files(networks: Networks) -> None:
    found = trained_tensors.tensors(networks)
    files = {
        trained_tensors.DETECTOR: read_tensors(packaged_detector_path())[0],
        trained_tensors.FIELD: read_tensors(packaged_field_path())[0],
    }
    for prefix, tensors in files.items():
        own = {key.removeprefix(prefix): value for key, value in found.items() if key.startswith(prefix)}
        assert own
        for name, value in own.items():
            np.testing.assert_array_equal(np.asarray(value), tensors[name].astype(np.float32))
        left_out = set(tensors) - set(own)
        assert left_out == (
            set() if prefix == trained_tensors.DETECTOR else {"low", "spacing", "shape", "near", "matter"}
        )


@pytest.mark.parametrize(
    "key",
    [
        "imaging.detector.first.stem.kernel",
        "imaging.detector.second.out_quality.bias",
        "imaging.field.network.1.weight",
        "imaging.field.features",
    ],
)
def test_a_changed_tensor_is_the_only_one_that_changes(networks: Networks, key: str) -> None:
    before = trained_tensors.tensors(networks)
    changed = trained_tensors.with_tensors(networks, {key: jnp.asarray(before[key], jnp.float64) + 1.0})
    for name, value in trained_tensors.tensors(changed).items():
        assert value.dtype == before[name].dtype
        np.testing.assert_array_equal(value, before[name] + np.float32(name == key))
    assert jax.tree.structure(changed) == jax.tree.structure(networks)
