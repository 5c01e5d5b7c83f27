"""Multilayer perceptron with rectified linear units, as a tuple of (weight, bias) pairs."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

Layers = tuple[tuple[Array, Array], ...]


def initialize_layers(key: Array, widths: Sequence[int]) -> Layers:
    """Random layers between widths, with the variance of He et al., "Delving deep into rectifiers", 2015."""
    layers = []
    for index, (fan_in, fan_out) in enumerate(itertools.pairwise(widths)):
        scale = np.float32(np.sqrt(2.0 / fan_in))
        weight = scale * jax.random.normal(jax.random.fold_in(key, 100 + index), (fan_in, fan_out), jnp.float32)
        layers.append((weight, jnp.zeros((fan_out,), jnp.float32)))
    return tuple(layers)


def apply_layers(layers: Layers, inputs: Array) -> Array:
    """Output of the network, linear in its last layer."""
    values = inputs
    for index, (weight, bias) in enumerate(layers):
        values = values @ weight + bias
        if index < len(layers) - 1:
            values = jax.nn.relu(values)
    return values
