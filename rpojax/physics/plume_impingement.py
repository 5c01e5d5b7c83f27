"""Plumes of small thrusters on the target: far field of a free plume, and free-molecular force on flat facets.

The density of the far field is that of Simons, Effect of Nozzle Boundary Layers on Rocket Exhaust Plumes, AIAA Journal
10, 1972; docs/theory/plume.md has the equations and their limits.
"""

import math
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe, trigonometric_series
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

_GAUSS_PLACES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(12)
_EDGE: Final = 0.5 * math.pi
"""Angle from the axis at which the plume ends [rad]: the exit plane, behind which the servicer is."""


@pytree
class Plume:
    """Gas of the small thrusters, and how it leaves the surface of the target."""

    specific_heat_ratio: Array = number(
        "ratio of the specific heats of the exhaust; 1.4 for nitrogen", above=1.0, at_most=5.0 / 3.0, default=1.4
    )
    exit_mach: Array = number("Mach number at the nozzle's exit", at_least=1.0, at_most=20.0, default=5.0)
    nozzle_half_angle: Array = number(
        "angle of the nozzle's wall to its axis at the exit", unit="deg", at_least=0.0, at_most=45.0, default=15.0
    )
    boundary_layer: Array = number(
        "thickness of the nozzle's boundary layer over the radius of the exit",
        at_least=0.001,
        at_most=0.5,
        default=0.1,
    )
    accommodation: Array = number(
        "share of molecules that leave the surface diffusely, at the wall's temperature; the rest is reflected",
        at_least=0.0,
        at_most=1.0,
        default=0.9,
    )
    wall_temperature: Array = number(
        "temperature of the target's surface over that of the gas in the chamber", at_least=0.0, default=1.0
    )


@pytree
class Facets:
    """Flat facets of the nominal target's convex hull, in T from its centre of mass.

    Attributes:
        centers: (f, 3) centroids [m]
        normals: (f, 3) unit vectors outwards
        areas: (f,) [m^2]
    """

    centers: Array
    normals: Array
    areas: Array


@pytree
class Impingement:
    """Load of plumes on the target, of each thruster or of all at each node of a step.

    Attributes:
        force_N: (n, 3) [N]
        torque_T: (n, 3) about the target's centre of mass [N m]
        size: (n,) sum of the sizes of the forces of the thrusters [N]
    """

    force_N: Array
    torque_T: Array
    size: Array


@pytree
class Shape:
    """Far field of a plume relative to its axis.

    Attributes:
        stretch: () angle of the cosine over that from the axis
        power: () exponent of the cosine
        border: () angle from the axis at which the gas of the boundary layer begins [rad]
        fall: () of its logarithm, per angle [1/rad]
    """

    stretch: Array
    power: Array
    border: Array
    fall: Array


def facets_of(triangles: np.ndarray) -> Facets:
    """Facets of triangles (f, 3, 3) of a convex surface [m], counter-clockwise from outside."""
    doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(doubled, axis=1)
    values = (triangles.mean(axis=1), doubled / size[:, None], 0.5 * size)
    centers, normals, areas = (jax.device_put(each) for each in values)
    return Facets(centers=centers, normals=normals, areas=areas)


def shape(plume: Plume) -> Shape:
    """Shape of the far field, Simons 1972; the fall has the slope that the core ends with."""
    gamma = plume.specific_heat_ratio
    ratio = (gamma + 1.0) / (gamma - 1.0)
    limit = 0.5 * math.pi * (jnp.sqrt(ratio) - 1.0) - _prandtl_meyer(gamma, plume.exit_mach) + plume.nozzle_half_angle
    stretch, power = 0.5 * math.pi / limit, 2.0 / (gamma - 1.0)
    from_limit = (2.0 * plume.boundary_layer) ** (1.0 / ratio)
    return Shape(
        stretch=stretch,
        power=power,
        border=(0.5 * math.pi - from_limit) / stretch,
        fall=power * stretch / jnp.tan(from_limit),
    )


def _prandtl_meyer(gamma: Scalar, mach: Scalar) -> Scalar:
    """Angle by which a sonic flow has turned when it has a Mach number [rad]."""
    root = jnp.sqrt((gamma + 1.0) / (gamma - 1.0))
    beyond = gradient_safe.sqrt(mach * mach - 1.0)
    return root * jnp.arctan(beyond / root) - jnp.arctan(beyond)


def relative_density(shape: Shape, angle: Float[Array, "*angles"]) -> Float[Array, "*angles"]:
    """Density at an angle from the axis [rad] over that on the axis at the same distance."""
    core = jnp.minimum(angle, shape.border)
    cosine = trigonometric_series.cos_sin(shape.stretch * core)[0]
    inside = jnp.exp(shape.power * jnp.log(cosine) - shape.fall * (angle - core))
    return jnp.where(angle < _EDGE, inside, 0.0)


def moment(shape: Shape, cosine_power: int) -> Scalar:
    """Integral of the relative density times a power of the cosine over the solid angle, over 2 pi."""
    border = jnp.minimum(shape.border, _EDGE)
    total = jnp.zeros_like(border)
    for begin, end in ((jnp.zeros_like(border), border), (border, jnp.full_like(border, _EDGE))):
        half = 0.5 * (end - begin)
        angle = begin + half * (1.0 + _GAUSS_PLACES.astype(half.dtype))
        cosine, sine = trigonometric_series.cos_sin(angle)
        density = relative_density(shape, angle)
        weights = half * _GAUSS_WEIGHTS.astype(half.dtype)
        total = total + jnp.sum(weights * density * sine * cosine**cosine_power, axis=0)
    return total


def reemission(plume: Plume) -> Scalar:
    """Momentum with which diffuse molecules leave a surface, over the momentum that came with them face-on.

    The mean normal speed sqrt(pi R T_w / 2) of molecules that leave a wall (Bird, Molecular Gas Dynamics and the Direct
    Simulation of Gas Flows, 1994, chapter 4) over the limiting speed of the gas.
    """
    gamma = plume.specific_heat_ratio
    return gradient_safe.sqrt(0.25 * math.pi * (gamma - 1.0) / gamma * plume.wall_temperature)


def loads(
    plume: Plume,
    facets: Facets,
    sources_T: Float[Array, "n 3"],
    forces_T: Float[Array, "n 3"],
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Force [N] and torque about the target's centre of mass [N m] in T of plumes from given places [m].

    `forces_T` [N] are those on the servicer, opposite the plumes. Facets that are turned away get nothing, which is all
    the shadow that a convex body casts on itself.
    """
    form = shape(plume)
    thrust = jax.vmap(gradient_safe.norm)(forces_T)
    axes_T = -jax.vmap(gradient_safe.normalize)(forces_T)
    along, across, caught = _weights(plume, form, facets, sources_T, axes_T)
    # Closer than the far field holds, facets would catch more momentum than the plume has.
    whole = 2.0 * math.pi * moment(form, 1)
    scale = thrust / jnp.maximum(whole, caught)
    along, across = scale[:, None] * along, scale[:, None] * across
    # A force along the flow acts on a line through the source, one across a facet at its centre.
    of_flow = _over_facets(along, facets.centers) - sources_T * jnp.sum(along, axis=1)[:, None]
    turning = jnp.cross(facets.centers, facets.normals)
    force_T = of_flow - _over_facets(across, facets.normals)
    return force_T, jnp.cross(sources_T, of_flow) - _over_facets(across, turning)


def _over_facets(factors: Float[Array, "n f"], of_facets: Float[Array, "f 3"]) -> Float[Array, "n 3"]:
    return jnp.stack([jnp.sum(factors * of_facets[None, :, axis], axis=1) for axis in range(3)], axis=1)


def _weights(
    plume: Plume, form: Shape, facets: Facets, sources_T: Float[Array, "n 3"], axes_T: Float[Array, "n 3"]
) -> tuple[Float[Array, "n f"], Float[Array, "n f"], Float[Array, " n"]]:
    """Factors of the vectors from the sources to the facets, and of the inward normals, in their forces; momentum met.

    For a dynamic pressure of the gas, density times squared speed, of 1 N/m^2 at 1 m on the axis. The last is what all
    facets catch of the momentum along the axis.
    """
    r = tuple(facets.centers[None, :, axis] - sources_T[:, axis, None] for axis in range(3))
    square = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
    per_length = jax.lax.rsqrt(jnp.where(square > 0.0, square, 1.0))
    # No facet takes more than half of all directions, which only one nearer than its own size would.
    per_square = 1.0 / jnp.maximum(square, facets.areas[None] / (2.0 * math.pi))
    on_axis, facing = (
        sum(r[axis] * each for axis, each in enumerate(components)) * per_length
        for components in (
            [axes_T[:, axis, None] for axis in range(3)],
            [-facets.normals[None, :, axis] for axis in range(3)],
        )
    )
    facing = jnp.maximum(facing, 0.0)
    off_axis = gradient_safe.sqrt(1.0 - on_axis * on_axis)
    density = relative_density(form, trigonometric_series.arctan2(off_axis, on_axis))
    received = density * facets.areas[None] * facing * per_square
    diffuse = plume.accommodation
    return (
        diffuse * received * per_length,
        received * (diffuse * reemission(plume) + 2.0 * (1.0 - diffuse) * facing),
        jnp.sum(received * jnp.maximum(on_axis, 0.0), axis=1),
    )
