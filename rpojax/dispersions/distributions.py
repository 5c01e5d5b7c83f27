"""Distributions of dispersed values about a nominal one, from a source of random numbers."""

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.dispersions.dispersion_kinds import (
    Choice,
    CorrelatedNormal,
    Derived,
    Dispersion,
    LogNormal,
    Normal,
    RandomAttitude,
    RandomDirection,
    SmallRotation,
    TruncatedNormal,
    Uniform,
)
from rpojax.dispersions.random_source import RandomSource
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.physics import equipment_faults


def sample(dispersion: Dispersion, nominal: Array, source: RandomSource) -> Array:
    """Value of a dispersion of one key, with the shape of `nominal`, in the unit of the key."""
    match dispersion:
        case Normal():
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape)
        case TruncatedNormal():
            low, high = ndtr(-dispersion.limit_sigmas), ndtr(dispersion.limit_sigmas)
            truncated = ndtri(low + (high - low) * source.uniforms(nominal.shape))
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * truncated
        case Uniform():
            return dispersion.low + (dispersion.high - dispersion.low) * source.uniforms(nominal.shape)
        case LogNormal():
            return nominal * jnp.exp(jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape))
        case Choice():
            choices = jnp.asarray([equipment_faults.kind_code(value) for value in dispersion.values], dtype=jnp.float64)
            return choices[source.integer(len(dispersion.values))]
        case RandomDirection():
            return source.direction()
        case RandomAttitude():
            return source.attitude()
        case SmallRotation():
            sigma = jnp.deg2rad(jnp.asarray(dispersion.sigma_deg, dtype=jnp.float64))
            return quaternion.multiply(quaternion.exp(sigma * source.normals((3,))), quaternion.normalize(nominal))
        case CorrelatedNormal() | Derived():
            raise AssertionError(f"{dispersion.kind} has no value of a single key")


def correlated_errors(dispersion: CorrelatedNormal, source: RandomSource) -> Float[Array, " n"]:
    """Zero-mean normal errors with the covariance of the dispersion; error `i` depends on the numbers up to `i`."""
    factor = cholesky_factor(np.array(dispersion.covariance))
    normals = source.normals((len(factor),))
    return jnp.sum(jnp.asarray(factor) * normals[None, :], axis=1)
