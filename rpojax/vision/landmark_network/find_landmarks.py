"""Landmarks of a target in a camera picture, from the box around it.

`find_landmarks(params, picture, box)` is what a closed loop calls: a pure function with static shapes, to be compiled,
batched by `jax.vmap` over picture and box, and differentiated in both. The picture has sRGB codes in 0..1 and any fixed
size; the box is that of a detector or of a prediction, in pixels, and may be clipped by the frame. Places and
covariances come in pixels of the picture, for all landmarks, in the order of the file of landmarks; what cannot be seen
has a small probability, and a large covariance if the network cannot infer it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.landmark_network.landmark_crop import CROP_PX, crop_picture, crop_place, to_picture
from rpojax.vision.landmark_network.network import Params, estimate

IN_SIGHT = 0.5
"""Probability above which a landmark counts as in sight [-]."""


@pytree
class FoundLandmarks:
    """Landmarks in a picture.

    Attributes:
        places: (k, 2) right and down of the upper left corner of the picture [px]
        covariance: (k, 2, 2) of the error of each place [px^2], positive definite
        visible_probability: (k,) that the landmark is in the frame and the crop, and not behind the target itself
    """

    places: Array
    covariance: Array
    visible_probability: Array

    @property
    def sigma(self) -> Float[Array, " k"]:
        """1 sigma of a place along either axis [px], in the mean over both."""
        return jnp.sqrt(0.5 * (self.covariance[:, 0, 0] + self.covariance[:, 1, 1]))


def find_landmarks(
    params: Params, picture: Float[Array, "h w 3"], box: Float[Array, "4"], frame: Float[Array, "4"] | None = None
) -> FoundLandmarks:
    """Landmarks in a picture of sRGB codes in 0..1 with a box (left, top, right, bottom) [px] around the target.

    `frame` are the edges of the camera's frame in the picture [px], by default those of the picture.
    """
    height, width = picture.shape[:2]
    whole = jnp.array([0.0, 0.0, width, height], jnp.float32)
    place = crop_place(box.astype(jnp.float32))
    crop = crop_picture(picture.astype(jnp.float32), place, whole if frame is None else frame)
    found = estimate(params, crop[None])
    root = found.roots[0] * (place.side / CROP_PX)
    return FoundLandmarks(
        places=to_picture(found.places[0], place),
        covariance=jnp.einsum("kij,klj->kil", root, root),
        visible_probability=jax.nn.sigmoid(found.visible_logit[0]),
    )
