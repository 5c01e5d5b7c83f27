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
from rpojax.vision.detector.non_maximum_suppression import suppress_overlapping
from rpojax.vision.detector.proposal_network import SIDE_MULTIPLE_PX, SUPPRESSION_IOU, Detections, ProposalMaps
from rpojax.vision.weight_files import (
    WeightsError,
    check_all_taken,
    read_model_card,
    read_tensors,
    take_tensor,
    write_tensors,
)

SCORE_THRESHOLD = 0.5
"""Score from which a box counts as seen."""
_KIND = "rpojax detector 2"

DetectorParams = dict[str, dict[str, dict[str, Array]]]
"""Arrays by look (first, second), layer and name."""
Images = Float[Array, "n h w 3"]

__all__ = ["SIDE_MULTIPLE_PX", "Detections", "DetectorParams"]


def initialize(key: Array) -> DetectorParams:
    """Untrained parameters."""
    first, second = jax.random.split(key)
    return {"first": proposal_network.initialize(first), "second": refinement_network.initialize(second)}


def detect(params: DetectorParams, images: Images, count: int = 4) -> Detections:
    """The `count` best boxes of each of a batch of pictures of float32 sRGB codes in 0..1.

    Sides of pictures are multiples of `MULTIPLE_PX`.
    """
    maps = proposal_network.forward(params["first"], images)

    def one(image: Array, heat: Array, edges: Array) -> Detections:
        found = proposal_network.decode_boxes(ProposalMaps(heatmap=heat, edges=edges), count)
        return _refine(params, image, found)

    return jax.vmap(one)(images, maps.heatmap, maps.edges)


def _refine(params: DetectorParams, image: Array, found: Detections) -> Detections:
    """Boxes after the second look; what has become the same box counts once."""
    box, quality_logit = refinement_network.refine_boxes(params["second"], image, found.box_px)
    box = proposal_network.clip_boxes(box, image.shape[0], image.shape[1])
    score = jnp.where(found.score > 0.0, _combined_score(found.score, quality_logit), 0.0)
    order = jnp.argsort(-score)
    kept = suppress_overlapping(box[order], score[order], SUPPRESSION_IOU)
    last = jnp.argsort(-kept)
    return Detections(box_px=box[order][last], score=kept[last])


def _combined_score(proposal_score: Array, quality_logit: Array) -> Array:
    """Score of both looks: their odds count alike."""
    proposal_score = jnp.clip(proposal_score, 1e-6, 1.0 - 1e-6)
    return jax.nn.sigmoid(0.5 * (jnp.log(proposal_score) - jnp.log1p(-proposal_score) + quality_logit))


def soft_detect(params: DetectorParams, image: Float[Array, "h w 3"]) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """The best box of a picture and its score, both differentiable in the picture."""
    maps = proposal_network.forward(params["first"], image[None])
    box, score = proposal_network.soft_decode_box(ProposalMaps(heatmap=maps.heatmap[0], edges=maps.edges[0]))
    boxes, quality_logit = refinement_network.refine_boxes(params["second"], image, box[None])
    return boxes[0], _combined_score(score, quality_logit[0])


def packaged_detector_path() -> Path:
    """Path of the packaged detector's weights."""
    return Path(str(resources.files("rpojax.vision") / "assets" / "detector.safetensors"))


def save_detector(params: DetectorParams, path: Path, card: Mapping[str, object]) -> None:
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


def round_to_half_precision(params: DetectorParams) -> DetectorParams:
    """Parameters as they come back from their file."""
    return jax.tree.map(lambda values: values.astype(jnp.float16).astype(jnp.float32), params)


def load_detector(path: Path | None = None) -> tuple[DetectorParams, dict[str, object]]:
    """Parameters (default: the packaged ones) and their card; raises `WeightsError` for a damaged or foreign file."""
    source = path or packaged_detector_path()
    tensors, metadata = read_tensors(source)
    if metadata.get("kind") != _KIND:
        found = metadata.get("kind", "")
        raise WeightsError(f"{source}: found kind {found!r}, expected a detector that `rpojax detector train` wrote")
    card = read_model_card(source, metadata)
    shapes = jax.eval_shape(initialize, jax.random.key(0))
    params = {
        look: {
            layer: {
                name: jnp.asarray(
                    take_tensor(source, tensors, f"{look}.{layer}.{name}", like.shape, np.float16).astype(np.float32)
                )
                for name, like in values.items()
            }
            for layer, values in layers.items()
        }
        for look, layers in shapes.items()
    }
    check_all_taken(source, tensors)
    return params, card
