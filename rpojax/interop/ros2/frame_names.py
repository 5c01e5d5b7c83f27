"""Names of the frames that messages speak of, and what ROS asks of orientations and covariances.

| frame id | letter | what |
|---|---|---|
| `eci` | N | inertial, Earth's centre, Earth's pole = +z |
| `hill` | H | the target's Hill frame (RTN), in the target: x radial outward, y along-track, z orbit normal |
| `servicer/base_link` | B | servicer body, in its centre of mass |
| `target/base_link` | T | target body, in its centre of mass |
| `servicer/camera_optical_frame` | K | camera: x right, y down, z along the boresight (REP 103) |

ROS `orientation` is the attitude of the child in its parent: it turns child components into parent components, so it is
the conjugate of `q_BN`, and its order is x, y, z, w. A pose's covariance is in the parent's axes, a twist and its
covariance in the child's (`nav_msgs/Odometry`).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

ECI = "eci"
HILL = "hill"
SERVICER = "servicer/base_link"
TARGET = "target/base_link"
CAMERA = "servicer/camera_optical_frame"

FRAME_IDS = (ECI, HILL, SERVICER, TARGET, CAMERA)

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Quaternion = Float[Array, "4"]


def orientation_from_quaternion(q_BA: Quaternion) -> Quaternion:
    """ROS orientation (x, y, z, w) of B in A, from the scalar-first `q_BA` that turns A into B components."""
    return jnp.concatenate([-q_BA[1:], q_BA[:1]])


def quaternion_from_orientation(xyzw: Quaternion) -> Quaternion:
    """The scalar-first `q_BA` of a ROS orientation (x, y, z, w) of B in A, inverse of `orientation`."""
    return jnp.concatenate([xyzw[3:], -xyzw[:3]])


def rotate_covariance(R: Matrix, P: Matrix) -> Matrix:
    """Covariance `P` in the axes into which `R` turns components: `R P R'`."""
    return R @ P @ R.T


def block_diagonal(first: Matrix, second: Matrix) -> Float[Array, "6 6"]:
    """Covariance of two 3-vectors that are not correlated: position and small rotation, or velocity and rate."""
    zero = jnp.zeros((3, 3), dtype=first.dtype)
    return jnp.concatenate(
        [jnp.concatenate([first, zero], axis=1), jnp.concatenate([zero, second], axis=1)],
        axis=0,
    )
