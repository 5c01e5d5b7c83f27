"""Dispersed values: one draw per run and key, from the run's own random stream."""

import zlib

import jax
import jax.numpy as jnp
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array

from rpojax.core import quaternion, random
from rpojax.core.random import Stream
from rpojax.physics import faults
from rpojax.simulation import params as parameters
from rpojax.simulation import schema
from rpojax.simulation.params import Params
from rpojax.simulation.schema import ScenarioFile

Values = dict[str, Array]


def draw(file: ScenarioFile, run_key: Array) -> Values:
    """Values of all dispersed keys of one run, in the user's units.

    A key's draw depends on the run and on the key's name, so adding a dispersion leaves the others as they were.
    """
    stream = random.fold_in(run_key, Stream.DISPERSION)
    values: Values = {}
    for dispersion in file.dispersions:
        key = random.fold_in(stream, zlib.crc32(dispersion.key.encode()) & 0x7FFFFFFF)
        nominal = jnp.asarray(schema.nominal(file, dispersion.key), dtype=jnp.float64)
        values[dispersion.key] = _draw_one(dispersion, nominal, key)
    return values


def _draw_one(dispersion: schema.Dispersion, nominal: Array, key: Array) -> Array:
    typed = jax.random.wrap_key_data(key, impl="threefry2x32")

    def normals(shape: tuple[int, ...]) -> Array:
        return jax.random.normal(typed, shape, dtype=jnp.float64)

    match dispersion:
        case schema.Normal():
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * normals(nominal.shape)
        case schema.TruncatedNormal():
            low, high = ndtr(-dispersion.limit_sigmas), ndtr(dispersion.limit_sigmas)
            share = jax.random.uniform(typed, nominal.shape, dtype=jnp.float64)
            cut = ndtri(low + (high - low) * share)
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * cut
        case schema.Uniform():
            share = jax.random.uniform(typed, nominal.shape, dtype=jnp.float64)
            return dispersion.low + (dispersion.high - dispersion.low) * share
        case schema.LogNormal():
            return nominal * jnp.exp(jnp.asarray(dispersion.sigma, dtype=jnp.float64) * normals(nominal.shape))
        case schema.Choice():
            choices = jnp.asarray([faults.code(value) for value in dispersion.values], dtype=jnp.float64)
            return choices[jax.random.randint(typed, (), 0, len(dispersion.values))]
        case schema.RandomDirection():
            return quaternion.normalize(normals((3,)))
        case schema.RandomAttitude():
            return quaternion.normalize(normals((4,)))
        case schema.SmallRotation():
            sigma = jnp.deg2rad(jnp.asarray(dispersion.sigma_deg, dtype=jnp.float64))
            return quaternion.multiply(quaternion.exp(sigma * normals((3,))), quaternion.normalize(nominal))


def apply(params: Params, values: Values) -> Params:
    """Params of one run: the nominal ones with the drawn values put in."""
    for key, value in values.items():
        path, factor = parameters.locate(key)
        params = parameters.put(params, path, value * factor)
    return params


def read_back(params: Params, keys: list[str]) -> Values:
    """The values that `params` really holds for the given keys, in the user's units."""
    values: Values = {}
    for key in keys:
        path, factor = parameters.locate(key)
        values[key] = parameters.get(params, path) / factor
    return values
