"""Two-stage detector of spacecraft in an image: a proposal network, and a refinement network on each proposed box."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.vision.detector import proposal_network, refinement_network
from rpojax.vision.detector.box_decoding import (
    SUPPRESSION_IOU,
    Detections,
    ProposalMaps,
    clip_boxes,
    decode_boxes,
    decode_peaks,
    soft_decode_boxes,
)
from rpojax.vision.detector.non_maximum_suppression import suppress_overlapping

SCORE_THRESHOLD = 0.5
"""Score from which a box counts as found."""

DetectorParams = dict[str, dict[str, dict[str, Array]]]
"""Arrays by network (proposal, refinement), layer and name."""
Images = Float[Array, "n h w 3"]


def initialize(key: Array) -> DetectorParams:
    """Untrained parameters."""
    proposal_key, refinement_key = jax.random.split(key)
    return {
        "proposal": proposal_network.initialize(proposal_key),
        "refinement": refinement_network.initialize(refinement_key),
    }


def detect(params: DetectorParams, images: Images, count: int = 4) -> Detections:
    """The `count` best boxes of each of a batch of images of float32 sRGB codes in 0..1.

    Sides of images are multiples of `SIDE_MULTIPLE_PX`.
    """
    maps, features = proposal_network.forward(params["proposal"], images)

    def detect_in_image(image: Array, maps: ProposalMaps, features: Array) -> Detections:
        return _refine(params, image, features, decode_boxes(maps, count))

    return jax.vmap(detect_in_image)(images, maps, features)


def _refine(params: DetectorParams, image: Array, features: Array, found: Detections) -> Detections:
    """Refined boxes with combined scores, after another non-maximum suppression."""
    box, quality_logit = refinement_network.refine_boxes(params["refinement"], image, features, found.box_px)
    box = clip_boxes(box, image.shape[0], image.shape[1])
    score = jnp.where(found.score > 0.0, _combined_score(found.score, quality_logit), 0.0)
    order = jnp.argsort(-score)
    kept = suppress_overlapping(box[order], score[order], SUPPRESSION_IOU)
    last = jnp.argsort(-kept)
    return Detections(box_px=box[order][last], score=kept[last])


def _combined_score(proposal_score: Array, quality_logit: Array) -> Array:
    """Score whose log-odds are the mean of those of both networks."""
    return jax.nn.sigmoid(_combined_log_odds(proposal_score, quality_logit))


def _combined_log_odds(proposal_score: Array, quality_logit: Array) -> Array:
    proposal_score = jnp.clip(proposal_score, 1e-6, 1.0 - 1e-6)
    return 0.5 * (jnp.log(proposal_score) - jnp.log1p(-proposal_score) + quality_logit)


def with_shifted_score(params: DetectorParams, log_odds: float) -> DetectorParams:
    """Parameters that give every box a score with log-odds higher by a number, and the same edges."""
    refinement = params["refinement"]
    layer = refinement[refinement_network.QUALITY_LAYER]
    # The score has the mean of the log-odds of two networks.
    moved = {**layer, "bias": layer["bias"] + jnp.asarray(2.0 * log_odds, layer["bias"].dtype)}
    return {**params, "refinement": {**refinement, refinement_network.QUALITY_LAYER: moved}}


def soft_detect(
    params: DetectorParams, image: Float[Array, "h w 3"], temperature: float = 0.25, count: int = 2
) -> tuple[Float[Array, "4"], Float[Array, ""]]:
    """The best box [px] of an image and the log-odds of its score, smooth in image and parameters.

    In place of the hottest cell of a peak it has a mean over the cells around it (`soft_decode_boxes`). Which of the
    `count` best peaks has the best box is decided, as in `detect`, and so is where peaks are.

    Args:
        params: of the networks
        image: (h, w, 3) sRGB codes in 0..1
        temperature: of the mean, in log-odds; for a low one box and score are those of `detect`
        count: number of peaks
    """
    maps, features = proposal_network.forward(params["proposal"], image[None])
    of_image = ProposalMaps(heatmap=maps.heatmap[0], edges=maps.edges[0])
    found, peaks = jax.lax.stop_gradient(decode_peaks(of_image, count))
    boxes, scores = soft_decode_boxes(of_image, peaks, temperature)
    refined, quality_logit = refinement_network.refine_boxes(params["refinement"], image, features[0], boxes)
    log_odds = _combined_log_odds(scores, quality_logit)
    best = jnp.argmax(jax.lax.stop_gradient(jnp.where(found.score > 0.0, log_odds, -jnp.inf)))
    return clip_boxes(refined, image.shape[0], image.shape[1])[best], log_odds[best]
