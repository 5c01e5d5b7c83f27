"""Linearisation of dispersions for a linear covariance: mean, and change per sigma of standard normal inputs."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.linear_covariance.linearisation import target_outline_ensemble
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import (
    GPS_BIAS,
    GYRO,
    GYRO_BIAS,
    HANDOVER,
    STAR_TRACKER,
    DeviationLayout,
    Path,
)
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import RandomKind
from rpojax.errors import RpojaxError
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import initial_state
from rpojax.simulation.noise import InitialNoise
from rpojax.simulation.state import State

_AT_START = ("initial", "orbit")
"""Sections of initial conditions, without effect on the rest of a run."""
_WIDEST_DEG = 10.0
"""Widest dispersion of an orbit's angle with a useful derivative: it turns everything [deg]."""
_POSITION, _VELOCITY = "initial.relative_position_m", "initial.relative_velocity_m_s"


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
        if entry.name in target_outline_ensemble.KEYS:
            continue
        if isinstance(entry, Derived):
            _derive(file, mean, columns, entry)
            continue
        centre, change = entry.linearise(dispersion_keys.nominal_numbers(file, entry))
        if _is_wide_angle(entry, change):
            left_out.append(entry.name)
            continue
        columns[entry.name] = {}
        rows = dispersion_keys.assigned_parts(file, entry, change)
        for (where, part), (_, own) in zip(dispersion_keys.assigned_parts(file, entry, centre), rows, strict=True):
            _enter(file, mean, where, np.asarray(part))
            _add_change(file, columns[entry.name], where, np.atleast_2d(own))
    return LinearisedDispersions(mean, columns, left_out)


def _is_wide_angle(entry: RandomKind, change: np.ndarray) -> bool:
    """Whether an angle of the orbit is dispersed too widely."""
    keys = [parameter.key for parameter in dispersion_keys.assigned_keys(entry)]
    angles = any(key.startswith("orbit.") and key.endswith("_deg") for key in keys)
    return angles and not entry.is_joint and bool(np.max(change) > _WIDEST_DEG)


def _derive(
    file: ScenarioFile, mean: dict[str, np.ndarray], columns: dict[str, dict[str, np.ndarray]], entry: Derived
) -> None:
    """Adds the mean and columns of a number that is a function of others."""
    where, terms = parse_key(entry.key), [parse_key(term.key) for term in entry.terms]
    shape = np.shape(nominal_value(file, where))
    _enter(file, mean, where, np.asarray(entry.value(shape, [_part(_mean_of(file, mean, key), key) for key in terms])))
    for change in columns.values():
        rows = [np.atleast_2d(_part(change[key.key], key)) if key.key in change else None for key in terms]
        own = entry.change(int(np.prod(shape)), rows)
        if own is not None:
            _add_change(file, change, where, own)


def _part(whole: np.ndarray, where: ParameterKey) -> np.ndarray:
    return whole if where.index is None else np.asarray(whole[where.index])


def _mean_of(file: ScenarioFile, mean: dict[str, np.ndarray], where: ParameterKey) -> np.ndarray:
    """Mean of a whole key, nominal if nothing has set it."""
    whole = ParameterKey(where.key, None)
    return mean.get(where.key, np.asarray(nominal_value(file, whole), dtype=float))


def _enter(file: ScenarioFile, mean: dict[str, np.ndarray], where: ParameterKey, value: np.ndarray) -> None:
    if where.index is not None:
        whole = _mean_of(file, mean, where).copy()
        whole[where.index] = value
        value = whole
    mean[where.key] = value


def _add_change(file: ScenarioFile, changes: dict[str, np.ndarray], where: ParameterKey, change: np.ndarray) -> None:
    """Adds the columns of a key, or of a component of it, to the columns of its source."""
    if where.index is not None:
        size = np.size(nominal_value(file, ParameterKey(where.key, None)))
        rows = np.zeros((size, change.shape[1]))
        rows[where.index] = change
        change = rows
    changes[where.key] = changes[where.key] + change if where.key in changes else change


@dataclass(frozen=True)
class InitialCondition:
    """Initial state of a nominal run, and the initial deviations.

    Attributes:
        state: of the loop
        columns: by source, deviations (size, inputs) of the vector per sigma
        mean_offset: (size,) mean of the vector over all runs, less that of the nominal run
    """

    state: State
    columns: dict[str, np.ndarray]
    mean_offset: np.ndarray


def initial_conditions(
    scenario: Scenario, params: Params, layout: DeviationLayout, key: Array, dispersions: LinearisedDispersions
) -> list[InitialCondition]:
    """Nominal runs on either side of the mean, whose covariances are averaged; a single one without dispersed position.

    They start one sigma beside the mean across the line of sight: the information of bearings on the range grows with
    the square of the offset, so that the two gain as much as runs do in the mean, and their errors are rotated as much
    out of the axes of H.
    """
    parts = _input_slices(dispersions)

    def initial_vector(inputs: Array, centre: Mapping[str, Array]) -> tuple[Array, State]:
        values = dict(centre)
        for name, changes in dispersions.columns.items():
            for key_of, change in changes.items():
                deviation = jnp.sum(jnp.asarray(change) * inputs[parts[name]][None, :], axis=1)
                values[key_of] = values[key_of] + deviation.reshape(values[key_of].shape)
        chosen = dispersed_values.apply_to_params(params, values)
        noise = InitialNoise(
            biases=jnp.concatenate([inputs[parts[GPS_BIAS]], inputs[parts[GYRO_BIAS]]]),
            box_edge_errors=None,
            handover=inputs[parts[HANDOVER]],
            star_tracker=inputs[parts[STAR_TRACKER]],
            gyro=inputs[parts[GYRO]],
        )
        state = initial_state.init(scenario, chosen, key, noise)
        return layout.pack(state, chosen), state

    @jax.jit
    def jacobian_and_vector(inputs: Array, centre: Mapping[str, Array]) -> tuple[tuple[Array, State], Array]:
        return jax.jacfwd(initial_vector, has_aux=True)(inputs, centre), initial_vector(inputs, centre)[0]

    zero = jnp.zeros(max(int(part.stop) for part in parts.values()))
    mean = {key_of: jnp.asarray(value) for key_of, value in dispersions.mean.items()}
    mean_vector = np.asarray(jacobian_and_vector(zero, mean)[1])
    until_s = scenario.formation_period_s + float(params.flight.formation.lead)
    rho_H = np.asarray(params.initial.relative_position)
    result = []
    for side in (1.0, -1.0) if {_POSITION, _VELOCITY} & {*mean} else (0.0,):
        off = {
            key_of: jnp.asarray(value) for key_of, value in _offset_from_mean(dispersions, rho_H, side, until_s).items()
        }
        (jacobian, state), vector = jacobian_and_vector(zero, mean | off)
        columns = {name: np.asarray(jacobian)[:, part] for name, part in parts.items()}
        result.append(InitialCondition(state, columns, mean_vector - np.asarray(vector)))
    return result


def _input_slices(dispersions: LinearisedDispersions) -> dict[str, slice]:
    """Slices of the standard normal inputs by source: the dispersions, then the initial noise."""
    widths = {name: next(iter(changes.values())).shape[1] for name, changes in dispersions.columns.items()}
    widths |= {HANDOVER: 12, GPS_BIAS: 3, GYRO_BIAS: 3, STAR_TRACKER: 3, GYRO: 3}
    edges = np.cumsum([0, *widths.values()])
    return {name: slice(*edges[i : i + 2]) for i, name in enumerate(widths)}


def _offset_from_mean(
    dispersions: LinearisedDispersions, rho_H: np.ndarray, side: float, until_s: float
) -> dict[str, np.ndarray]:
    """Position and velocity off the mean across the line of sight along `rho_H`, on one `side` (1 or -1).

    Position and velocity are drawn independently, so that the distance grows as the root of the sum of their squares;
    it is approximated by a straight line from the start to `until_s`.
    """
    position, velocity = (_sigma(dispersions, key) for key in (_POSITION, _VELOCITY))
    speed = (np.hypot(position, velocity * until_s) - position) / until_s
    line = rho_H / np.linalg.norm(rho_H)
    # Free motion in the orbit plane distinguishes the two sides; across the plane it does not.
    sides = np.array([side, side, 1.0])
    off = {_POSITION: sides * position, _VELOCITY: sides * speed}
    return {
        key: dispersions.mean[key] + value - line * (line @ value)
        for key, value in off.items()
        if key in dispersions.mean
    }


def _sigma(dispersions: LinearisedDispersions, key: str) -> np.ndarray:
    """Standard deviations (3,) of a dispersed vector, zero if it is not dispersed."""
    changes = [column[key] for column in dispersions.columns.values() if key in column]
    return np.sqrt(np.sum(np.concatenate([*changes, np.zeros((3, 1))], axis=1) ** 2, axis=1))
