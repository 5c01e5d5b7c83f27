"""Linearisation of dispersions for a linear covariance: mean, and change per sigma of standard normal inputs."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.stats import truncnorm

from rpojax.analysis.linear_covariance.linearisation import target_outline_ensemble
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import Path
from rpojax.core import quaternion
from rpojax.dispersions import dispersion_kinds
from rpojax.dispersions.dispersion_kinds import Dispersion
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.errors import RpojaxError
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_AT_START = ("initial", "orbit")
"""Sections of initial conditions, without effect on the rest of a run."""
_WIDEST_DEG = 10.0
"""Widest dispersion of an orbit's angle with a useful derivative: it turns everything [deg]."""


@dataclass(frozen=True)
class LinearisedDispersions:
    """Dispersed numbers as a mean and independent standard normal inputs.

    Attributes:
        mean: by key, in the user's units
        columns: by source and key, the change (size, inputs) per sigma of each input
        left_out: names of dispersions that are too wide for a derivative
    """

    mean: dict[str, np.ndarray]
    columns: dict[str, dict[str, np.ndarray]]
    left_out: list[str]

    def constant_paths(self) -> tuple[Path, ...]:
        """Paths in `Params` of the numbers that are constant in a run and act on it."""
        return tuple(parameters.leaf_path_and_factor(key)[0] for key in self.mean if key.split(".")[0] not in _AT_START)


def linearise_dispersions(file: ScenarioFile) -> LinearisedDispersions:
    """Mean and columns of all dispersions with small deviations; those of the tumble are left to the ensemble.

    Raises:
        RpojaxError: a dispersion without mean and variance, or values that a table or grid gives.
    """
    if dispersion_keys.design_keys(file):
        raise RpojaxError(f"design.kind: found {file.design.kind!r}, expected draws from distributions")
    mean: dict[str, np.ndarray] = {}
    columns: dict[str, dict[str, np.ndarray]] = {}
    left_out: list[str] = []
    for entry in dispersion_keys.evaluation_order(file):
        name = dispersion_keys.dispersion_name(entry)
        if name in target_outline_ensemble.KEYS:
            continue
        match entry:
            case dispersion_kinds.CorrelatedNormal():
                columns[name] = _correlated(file, mean, entry)
            case dispersion_kinds.Derived():
                _derive(file, mean, columns, entry)
            case _:
                where = parse_key(entry.key)
                centre, change = _own(entry, np.asarray(nominal_value(file, where), dtype=float))
                if where.key.startswith("orbit.") and where.key.endswith("_deg") and np.max(change) > _WIDEST_DEG:
                    left_out.append(name)
                    continue
                _enter(file, mean, where, centre)
                columns[name] = {where.key: _whole(file, where, change)}
    return LinearisedDispersions(mean, columns, left_out)


def _own(entry: Dispersion, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (...) and columns (size, inputs) of a dispersion of one key or component."""
    size = nominal.size
    match entry:
        case dispersion_kinds.Normal():
            sigma = np.broadcast_to(np.asarray(entry.sigma, dtype=float), nominal.shape)
            return nominal, np.diag(sigma.reshape(-1))
        case dispersion_kinds.TruncatedNormal():
            cut = truncnorm.std(-entry.limit_sigmas, entry.limit_sigmas)
            sigma = cut * np.broadcast_to(np.asarray(entry.sigma, dtype=float), nominal.shape)
            return nominal, np.diag(sigma.reshape(-1))
        case dispersion_kinds.Uniform():
            middle = np.full_like(nominal, 0.5 * (entry.low + entry.high))
            return middle, (entry.high - entry.low) / np.sqrt(12.0) * np.eye(size)
        case dispersion_kinds.LogNormal():
            square = np.broadcast_to(np.asarray(entry.sigma, dtype=float) ** 2, nominal.shape)
            mean = np.asarray(nominal * np.exp(0.5 * square))
            return mean, np.diag((np.abs(mean) * np.sqrt(np.expm1(square))).reshape(-1))
        case dispersion_kinds.SmallRotation():
            sigma = np.broadcast_to(np.deg2rad(np.asarray(entry.sigma_deg, dtype=float)), (3,))

            def turned(angle: Array) -> Array:
                return quaternion.multiply(quaternion.exp(angle), quaternion.normalize(jnp.asarray(nominal)))

            return np.asarray(turned(jnp.zeros(3))), np.asarray(jax.jacfwd(turned)(jnp.zeros(3))) * sigma
        case _:
            raise RpojaxError(
                f"dispersions: found kind {entry.kind!r} for {dispersion_keys.dispersion_name(entry)!r}, "
                "expected one with small deviations from a mean"
            )


def _correlated(file: ScenarioFile, mean: dict[str, np.ndarray], entry: dispersion_kinds.CorrelatedNormal) -> dict:
    factor = cholesky_factor(np.array(entry.covariance))
    change: dict[str, np.ndarray] = {}
    for row, where in zip(factor, expand_vectors(file, entry.keys), strict=True):
        _enter(file, mean, where, np.asarray(nominal_value(file, where), dtype=float))
        whole = _whole(file, where, row[None, :])
        change[where.key] = change.get(where.key, 0.0) + whole
    return change


def _derive(
    file: ScenarioFile,
    mean: dict[str, np.ndarray],
    columns: dict[str, dict[str, np.ndarray]],
    entry: dispersion_kinds.Derived,
) -> None:
    """Adds the mean and columns of a number that is a linear function of others."""
    where = parse_key(entry.key)
    shape = np.shape(nominal_value(file, where))
    total = np.broadcast_to(np.asarray(entry.offset, dtype=float), shape)
    for term in entry.terms:
        other = parse_key(term.key)
        base = mean.get(
            other.key,
            np.asarray(nominal_value(file, parse_key(other.key)), dtype=float),
        )
        total = total + np.broadcast_to(term.factor * (base if other.index is None else base[other.index]), shape)
        for change in columns.values():
            if other.key in change:
                rows = change[other.key] if other.index is None else change[other.key][other.index][None, :]
                own = np.broadcast_to(term.factor * rows, (int(np.prod(shape)), rows.shape[1]))
                change[where.key] = change.get(where.key, 0.0) + _whole(file, where, own)
    _enter(file, mean, where, np.asarray(total))


def _enter(file: ScenarioFile, mean: dict[str, np.ndarray], where: ParameterKey, value: np.ndarray) -> None:
    whole = mean.get(
        where.key,
        np.asarray(nominal_value(file, ParameterKey(where.key, None)), dtype=float),
    )
    if where.index is None:
        whole = value
    else:
        whole = whole.copy()
        whole[where.index] = value
    mean[where.key] = whole


def _whole(file: ScenarioFile, where: ParameterKey, change: np.ndarray) -> np.ndarray:
    """Columns of a whole key from those of one component."""
    if where.index is None:
        return change
    size = np.size(nominal_value(file, ParameterKey(where.key, None)))
    rows = np.zeros((size, change.shape[1]))
    rows[where.index] = change
    return rows
