"""Tensors of the trained networks of a rendered camera as numbers of a run, by the names of their files.

`imaging.detector.second.out_quality.bias` is the tensor `second.out_quality.bias` of the file that `imaging.detector`
names, and `imaging.field.network.2.bias` one of the field's.
"""

from collections.abc import Mapping
from typing import Any, Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.scenario.checks.validation_errors import did_you_mean
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.sensors.rendered_camera import Networks
from rpojax.vision.detector.detector_file import NAME_IN_FILES
from rpojax.vision.radiance_field.grid_field import GridField

DETECTOR: Final = "imaging.detector."
FIELD: Final = "imaging.field."
_NETWORK_OF_NAME: Final = {name: network for network, name in NAME_IN_FILES.items()}
_FEATURES: Final = "features"
_NETWORKS: Final = ("network", "material", "fill_network")


def is_tensor(key: str) -> bool:
    """Whether a key names a tensor of a trained file, of those that have a derivative."""
    return key.startswith((DETECTOR, FIELD))


def tensors(networks: Networks) -> dict[str, Array]:
    """All tensors of detector and field by key, without those of the field's geometry, which have no derivative."""
    found = {
        f"{DETECTOR}{NAME_IN_FILES[network]}.{layer}.{name}": value
        for network, layers in networks.detector.items()
        for layer, values in layers.items()
        for name, value in values.items()
    }
    if isinstance(networks.field, GridField):
        found[FIELD + _FEATURES] = networks.field.features
        for network in _NETWORKS:
            for index, layer in enumerate(getattr(networks.field, network)):
                found |= {f"{FIELD}{network}.{index}.{name}": layer[_place(name)] for name in ("weight", "bias")}
    return found


def nominal(params: Params, key: str) -> np.ndarray:
    """Tensor of a key, in double precision.

    Raises:
        RpojaxError: there is none of that name, or no rendered camera.
    """
    if params.networks is None:
        raise RpojaxError(f"{key}: found a scenario without a rendered camera, expected camera.model = 'rendered'")
    known = tensors(params.networks)
    if key not in known:
        raise RpojaxError(
            f"{key}: found no such tensor of detector or field, expected one{did_you_mean(key, list(known))}"
        )
    return np.asarray(known[key], dtype=np.float64)


def apply_to_params(params: Params, values: Values) -> Params:
    """Parameters of one run with dispersed values and tensors of networks."""
    numbers = {key: value for key, value in values.items() if not is_tensor(key)}
    changed = {key: value for key, value in values.items() if is_tensor(key)}
    params = dispersed_values.apply_to_params(params, numbers)
    return replace(params, networks=with_tensors(params.networks, changed)) if changed else params


def with_tensors(networks: Networks | None, changed: Mapping[str, Array]) -> Networks:
    """Networks with some tensors, by key, in the precision of those in their place."""
    assert networks is not None
    detector: Any = {
        network: {layer: dict(own) for layer, own in of.items()} for network, of in networks.detector.items()
    }
    field = networks.field
    for key, value in changed.items():
        if key.startswith(DETECTOR):
            network, layer, name = key.removeprefix(DETECTOR).split(".")
            own = detector[_NETWORK_OF_NAME[network]][layer]
            own[name] = jnp.asarray(value).astype(own[name].dtype)
            continue
        assert isinstance(field, GridField)
        path = key.removeprefix(FIELD).split(".")
        if path == [_FEATURES]:
            field = replace(field, features=jnp.asarray(value).astype(field.features.dtype))
        else:
            layers = [list(layer) for layer in getattr(field, path[0])]
            layer, place = layers[int(path[1])], _place(path[2])
            layer[place] = jnp.asarray(value).astype(layer[place].dtype)
            field = replace(field, **{path[0]: tuple((weight, bias) for weight, bias in layers)})
    return replace(networks, detector=detector, field=field)


def _place(name: str) -> int:
    """Place of a tensor in its layer."""
    return ("weight", "bias").index(name)
