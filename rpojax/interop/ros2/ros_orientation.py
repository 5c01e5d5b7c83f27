"""ROS orientations from attitude quaternions, and back.

A ROS `orientation` is the attitude of the child frame in its parent: it turns child components into parent components,
so it is the conjugate of the scalar-first `q_BN`, in the order x, y, z, w.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Quaternion = Float[Array, "4"]


def orientation_from_quaternion(q_BA: Quaternion) -> Quaternion:
    """ROS orientation (x, y, z, w) of B in A, from the scalar-first `q_BA` that turns A into B components."""
    return jnp.concatenate([-q_BA[1:], q_BA[:1]])


def quaternion_from_orientation(xyzw: Quaternion) -> Quaternion:
    """Scalar-first `q_BA` of a ROS orientation (x, y, z, w) of B in A, inverse of `orientation_from_quaternion`."""
    return jnp.concatenate([xyzw[3:], -xyzw[:3]])
