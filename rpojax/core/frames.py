"""Reference frames and their letters; the Hill frame of an orbit and the frame of a camera.

| letter | frame or point |
|---|---|
| N | inertial (ECI), Earth's pole = +z |
| H | the target's Hill frame (RTN): x radial outward, y along-track, z orbit normal |
| B | servicer body, origin S at its centre of mass |
| T | target body, origin T at its centre of mass |
| K | camera: x right, y down, z along the boresight |

`r_SN_N` is the position of S from N's origin in N components; `q_BN` and `R_BN` turn N components into B components;
`omega_BN_B` is the rate of B relative to N in B components. The relative state is the servicer from the target:
`rho_H = r_ST_H`, and `rho_dot_H` is its derivative seen in H. Thrust direction is the force on the servicer.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics.gradient_safe import normalize
from rpojax.core.vectors import apply, apply_transposed, cross

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


def hill_frame(r_TN_N: Vector, v_TN_N: Vector) -> tuple[Matrix, Vector]:
    """Hill frame of an orbit from its position [m] and velocity [m/s]: `R_HN` and `omega_HN_N` [rad/s].

    The rate is that of the osculating frame: it neglects the precession of the orbit plane by J2 (1e-7 rad/s).
    """
    momentum = cross(r_TN_N, v_TN_N)
    radial, normal = normalize(r_TN_N), normalize(momentum)
    R_HN = jnp.stack([radial, cross(normal, radial), normal])
    return R_HN, momentum / jnp.sum(r_TN_N * r_TN_N, axis=0)


def inertial_to_hill(r_N: Vector, v_N: Vector, R_HN: Matrix, omega_HN_N: Vector) -> tuple[Vector, Vector]:
    """Relative position [m] and velocity [m/s] in N axes as `rho`, `rho_dot` in the rotating Hill frame."""
    return apply(R_HN, r_N), apply(R_HN, v_N - cross(omega_HN_N, r_N))


def hill_to_inertial(rho_H: Vector, rho_dot_H: Vector, R_HN: Matrix, omega_HN_N: Vector) -> tuple[Vector, Vector]:
    """Inverse of `inertial_to_hill`."""
    r_N = apply_transposed(R_HN, rho_H)
    return r_N, apply_transposed(R_HN, rho_dot_H) + cross(omega_HN_N, r_N)


def look_at(direction_N: Vector, right_N: Vector) -> Matrix:
    """`R_KN` of a camera that looks along the unit vector `direction_N`, its x axis nearest to `right_N`."""
    along = jnp.sum(right_N * direction_N, axis=0)
    x = normalize(right_N - along * direction_N)
    return jnp.stack([x, cross(direction_N, x), direction_N])
