"""Landmark network: from a crop of a target to the place, its covariance, and the visibility of each landmark.

The crop goes down to a thirty-second of its resolution and back up to a quarter of it (Ronneberger et al., "U-Net",
2015). There each landmark has a heat map, whose mean around its peak is its place (Sun et al., "Integral Human Pose
Regression", ECCV 2018). The features under the heat map give a small correction of the place, its covariance, and
whether the landmark is visible.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.detector.convolution import convolution, output_layer
from rpojax.vision.detector.proposal_network import upsample
from rpojax.vision.landmark_network.landmark_crop import CHANNELS, CROP_PX

MAP_CELLS = CROP_PX // 4
"""Cells of a heat map along a side of the crop."""
CELL_PX = CROP_PX // MAP_CELLS
_WIDTHS = (16, 32, 64, 112, 144)
"""Features at a half, a quarter ... of the resolution."""
_HIDDEN = 64
_OUTPUTS = 6
"""Of each landmark: correction of the place (2), shape of the covariance (3), logit of visibility."""
_WINDOW_CELLS = 3
"""From the peak of a heat map to the edge of the square whose mean is the place."""
_LEAST_SIGMA_PX = 0.05
Params = dict[str, Any]


@pytree
class LandmarkEstimates:
    """What the network finds in crops.

    Attributes:
        places: (n, k, 2) right and down of the upper left corner of the crop [crop px]
        roots: (n, k, 2, 2) lower triangular root of the covariance of a place [crop px]
        visible_logit: (n, k) log-odds that the landmark is in sight
        heat: (n, 24, 24, k) logits of the cells
    """

    places: Array
    roots: Array
    visible_logit: Array
    heat: Array


class _PerLandmark(linen.Module):
    """Linear layer (n, k, c) to (n, k, o) with weights of its own for each landmark."""

    outputs: int

    @linen.compact
    def __call__(self, values: Array) -> Array:
        count, width = values.shape[1:]
        kernel = self.param("kernel", linen.initializers.normal(0.02, jnp.float32), (count, width, self.outputs))
        bias = self.param("bias", linen.initializers.zeros_init(), (count, self.outputs), jnp.float32)
        return jnp.einsum("nkc,kco->nko", values, kernel) + bias[None]


class LandmarkNetwork(linen.Module):
    """Crops (n, 96, 96, 4) to `LandmarkEstimates` of `count` landmarks."""

    count: int

    @linen.compact
    def __call__(self, crops: Array) -> LandmarkEstimates:
        features, whole = self._features(crops)
        heat = output_layer("out_heat", self.count)(features)
        attention = jax.nn.softmax(heat.reshape(-1, MAP_CELLS * MAP_CELLS, self.count), axis=1)
        cells = features.reshape(-1, MAP_CELLS * MAP_CELLS, features.shape[-1])
        under = jnp.einsum("nck,ncf->nkf", attention, cells)
        middle, spread = _moments(attention)
        hidden = convolution("hidden", _HIDDEN, size=1)(
            jnp.concatenate([under, jnp.log(spread + 0.1)], axis=-1)[:, :, None, :]
        )
        hidden = linen.relu(hidden[:, :, 0] + convolution("whole", _HIDDEN, size=1)(whole)[:, :, 0])
        raw = _PerLandmark(_OUTPUTS, name="out_landmark")(hidden)
        return LandmarkEstimates(
            places=middle + CELL_PX * raw[..., :2],
            roots=_roots(raw[..., 2:5]),
            visible_logit=raw[..., 5],
            heat=heat,
        )

    def _features(self, crops: Array) -> tuple[Array, Array]:
        """Features (n, 24, 24, c) of the cells, and of the whole crop (n, 1, 1, c)."""
        level = linen.relu(convolution("stem", _WIDTHS[0], stride=2)(crops))
        levels = []
        for index, blocks in enumerate((1, 2, 2, 2), start=1):
            level = linen.relu(convolution(f"down{index}", _WIDTHS[index], stride=2)(level))
            for block in range(blocks):
                level = level + linen.relu(convolution(f"level{index}_{block}", _WIDTHS[index])(level))
            levels.append(level)
        whole = jnp.mean(level, axis=(1, 2), keepdims=True)
        for index in (3, 2, 1):
            lateral = levels[index - 1]
            level = linen.relu(lateral + upsample(convolution(f"up{index}", _WIDTHS[index], size=1)(level)))
            level = level + linen.relu(convolution(f"blend{index}", _WIDTHS[index])(level))
        return level, whole


def _moments(attention: Float[Array, "n c k"]) -> tuple[Float[Array, "n k 2"], Float[Array, "n k 2"]]:
    """Mean of heat maps around their peaks, and their standard deviations [crop px].

    Of two places that a landmark may be at the mean of all would be neither.
    """
    cells = jnp.arange(MAP_CELLS * MAP_CELLS, dtype=jnp.int32)
    number = jnp.stack([cells % MAP_CELLS, cells // MAP_CELLS], axis=1)
    grid = (number.astype(attention.dtype) + 0.5) * CELL_PX
    peak = number[jnp.argmax(attention, axis=1)]
    near = jnp.all(jnp.abs(number[None, :, None] - peak[:, None]) <= _WINDOW_CELLS, axis=-1)
    around = attention * near.astype(attention.dtype)
    middle = jnp.einsum("nck,ca->nka", around, grid) / jnp.sum(around, axis=1)[..., None]
    mean = jnp.einsum("nck,ca->nka", attention, grid)
    square = jnp.einsum("nck,ca->nka", attention, grid * grid)
    return middle, jnp.sqrt(jnp.maximum(square - mean * mean, 0.0) + 1e-4)


def _roots(raw: Float[Array, "n k 3"]) -> Float[Array, "n k 2 2"]:
    """Lower triangular matrices with a positive diagonal [crop px]."""
    diagonal = _LEAST_SIGMA_PX + CELL_PX * jax.nn.softplus(raw[..., :2])
    zero = jnp.zeros_like(raw[..., 0])
    upper = jnp.stack([diagonal[..., 0], zero], axis=-1)
    return jnp.stack([upper, jnp.stack([CELL_PX * raw[..., 2], diagonal[..., 1]], axis=-1)], axis=-2)


def initialize(key: Array, count: int) -> Params:
    """Untrained parameters for `count` landmarks."""
    crops = jnp.zeros((1, CROP_PX, CROP_PX, CHANNELS), jnp.float32)
    return dict(jax.jit(LandmarkNetwork(count).init)(key, crops)["params"])


def estimate(params: Params, crops: Float[Array, "n 96 96 4"]) -> LandmarkEstimates:
    """What a network finds in crops."""
    result: Any = LandmarkNetwork(params["out_landmark"]["bias"].shape[0]).apply({"params": params}, crops)
    return result
