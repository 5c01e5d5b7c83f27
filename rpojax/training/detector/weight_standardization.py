"""Weight standardisation with a gain per channel, used in training in place of normalisation layers.

After Brock et al., "Characterizing signal propagation to close the performance gap in unnormalized ResNets", ICLR 2021.
The products are what is stored, so that inference has no such step.
"""

from typing import Any

import jax
import jax.numpy as jnp

Params = dict[str, Any]
"""Arrays of one network by layer and name."""
_OUTPUT_PREFIX = "out"


def is_output(layer: str) -> bool:
    """Whether a layer gives results of the network; these are not standardised."""
    return layer.startswith(_OUTPUT_PREFIX)


def with_channel_gains(params: Params) -> Params:
    """Trained arrays: the parameters, and a gain per channel for every convolution but the last."""
    gains = {
        layer: {"gain": _channel_norm(values["kernel"])} for layer, values in params.items() if not is_output(layer)
    }
    return {layer: {**values, **gains.get(layer, {})} for layer, values in params.items()}


def apply_channel_gains(trained: Params) -> Params:
    """Parameters of the network: kernels with channels of zero mean whose norm is the gain."""
    return {
        layer: {"kernel": _standardized_kernel(values), "bias": values["bias"]} for layer, values in trained.items()
    }


def _channel_norm(kernel: jax.Array) -> jax.Array:
    """Norm of every channel of a kernel, less its mean."""
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return jnp.sqrt(jnp.sum(centered**2, axis=(0, 1, 2)) + 1e-8)


def _standardized_kernel(values: dict[str, jax.Array]) -> jax.Array:
    kernel = values["kernel"]
    if "gain" not in values:
        return kernel
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return centered / _channel_norm(kernel)[None, None, None, :] * values["gain"][None, None, None, :]
