"""The detector: from a picture to boxes of spacecraft, by a look at the whole of it and one at each box."""

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.vision.detector import proposal_network, refinement_network
from rpojax.vision.detector.non_maximum_suppression import suppress
from rpojax.vision.detector.proposal_network import MULTIPLE_PX, SUPPRESSION_IOU, Detections, Maps
from rpojax.vision.weight_files import WeightsError, nothing_left, read_card, read_tensors, take, write_tensors

THRESHOLD = 0.5
"""Score from which a box counts as seen."""
_KIND = "rpojax detector 2"

Params = dict[str, dict[str, dict[str, Array]]]
"""Arrays by look (first, second), layer and name."""
Images = Float[Array, "n h w 3"]

__all__ = ["MULTIPLE_PX", "Detections", "Params"]


def fresh(key: Array) -> Params:
    """Untrained parameters."""
    first, second = jax.random.split(key)
    return {"first": proposal_network.fresh(first), "second": refinement_network.fresh(second)}


def detect(params: Params, images: Images, count: int = 4) -> Detections:
    """The `count` best boxes of each of a batch of pictures of float32 sRGB codes in 0..1.

    Sides of pictures are multiples of `MULTIPLE_PX`.
    """
    maps = proposal_network.forward(params["first"], images)

    def one(image: Array, heat: Array, edges: Array) -> Detections:
        found = proposal_network.decode(Maps(heat=heat, edges=edges), count)
        return _again(params, image, found)

    return jax.vmap(one)(images, maps.heat, maps.edges)


def _again(params: Params, image: Array, found: Detections) -> Detections:
    """Boxes after the second look; what has become the same box counts once."""
    box, goodness = refinement_network.look(params["second"], image, found.box_px)
    box = proposal_network.clip(box, image.shape[0], image.shape[1])
    score = jnp.where(found.score > 0.0, _joint(found.score, goodness), 0.0)
    order = jnp.argsort(-score)
    kept = suppress(box[order], score[order], SUPPRESSION_IOU)
    last = jnp.argsort(-kept)
    return Detections(box_px=box[order][last], score=kept[last])


def _joint(first: Array, goodness: Array) -> Array:
    """Score of both looks: their odds count alike."""
    first = jnp.clip(first, 1e-6, 1.0 - 1e-6)
    return jax.nn.sigmoid(0.5 * (jnp.log(first) - jnp.log1p(-first) + goodness))


def soft_detect(params: Params, image: Float[Array, "h w 3"]) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """The best box of a picture and its score, both differentiable in the picture."""
    maps = proposal_network.forward(params["first"], image[None])
    box, score = proposal_network.soft_decode(Maps(heat=maps.heat[0], edges=maps.edges[0]))
    boxes, goodness = refinement_network.look(params["second"], image, box[None])
    return boxes[0], _joint(score, goodness[0])


def packaged_detector() -> Path:
    """Path of the packaged detector's weights."""
    return Path(str(resources.files("rpojax.vision") / "assets" / "detector.safetensors"))


def save_detector(params: Params, path: Path, card: Mapping[str, object]) -> None:
    """Writes parameters in half precision with their card; the file is either whole or as it was before.

    Raises `WeightsError` where a parameter is not finite: a training that has gone astray replaces nothing.
    """
    with np.errstate(over="ignore"):  # what is beyond half precision is told below
        tensors = {
            f"{look}.{layer}.{name}": np.asarray(values[name]).astype(np.float16)
            for look, layers in params.items()
            for layer, values in layers.items()
            for name in values
        }
    for name, values in tensors.items():
        if not np.isfinite(values).all():
            raise WeightsError(f"{path}: {name}: found a number that is not finite, expected finite weights")
    write_tensors(path, tensors, {"kind": _KIND, "card": json.dumps(dict(card))})


def rounded(params: Params) -> Params:
    """Parameters as they come back from their file."""
    return jax.tree.map(lambda values: values.astype(jnp.float16).astype(jnp.float32), params)


def load_detector(path: Path | None = None) -> tuple[Params, dict[str, object]]:
    """Parameters (default: the packaged ones) and their card; raises `WeightsError` for a damaged or foreign file."""
    source = path or packaged_detector()
    tensors, metadata = read_tensors(source)
    if metadata.get("kind") != _KIND:
        found = metadata.get("kind", "")
        raise WeightsError(f"{source}: found kind {found!r}, expected a detector that `rpojax detector train` wrote")
    card = read_card(source, metadata)
    shapes = jax.eval_shape(fresh, jax.random.key(0))
    params = {
        look: {
            layer: {
                name: jnp.asarray(
                    take(source, tensors, f"{look}.{layer}.{name}", like.shape, np.float16).astype(np.float32)
                )
                for name, like in values.items()
            }
            for layer, values in layers.items()
        }
        for look, layers in shapes.items()
    }
    nothing_left(source, tensors)
    return params, card
