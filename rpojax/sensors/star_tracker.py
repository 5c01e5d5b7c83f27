"""Star tracker: inertial attitude of the body with noise and a fixed misalignment."""

from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class StarTracker:
    """Star tracker.

    Attributes:
        noise: (3,) white noise about each body axis, 1 sigma [rad]
        misalignment: (3,) small rotation of its axes [rad]
    """

    noise: Array
    misalignment: Array


def measure(star_tracker: StarTracker, q_BN: Float[Array, "4"], normals: Vector) -> Float[Array, "4"]:
    """Measured attitude `q_BN`."""
    error = quaternion.exp(star_tracker.misalignment + star_tracker.noise * normals)
    return quaternion.multiply(error, q_BN)
