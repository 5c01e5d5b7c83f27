"""Initial states of the nominal runs of a linear covariance, and the initial deviations."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.linear_covariance.linearisation.deviation_vector import DeviationLayout
from rpojax.analysis.linear_covariance.linearisation.dispersion_linearisation import LinearisedDispersions
from rpojax.analysis.linear_covariance.linearisation.error_sources import (
    GPS_BIAS,
    GYRO,
    GYRO_BIAS,
    HANDOVER,
    STAR_TRACKER,
)
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import initial_state
from rpojax.simulation.noise import InitialNoise
from rpojax.simulation.state import State

_POSITION, _VELOCITY = "initial.relative_position_m", "initial.relative_velocity_m_s"


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
    """Two nominal runs, one on either side of the mean, whose covariances are averaged; one without dispersed position.

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
        key: dispersions.mean[key] + each - line * (line @ each) for key, each in off.items() if key in dispersions.mean
    }


def _sigma(dispersions: LinearisedDispersions, key: str) -> np.ndarray:
    """Standard deviations (3,) of a dispersed vector, zero if it is not dispersed."""
    changes = [each[key] for each in dispersions.columns.values() if key in each]
    return np.sqrt(np.sum(np.concatenate([*changes, np.zeros((3, 1))], axis=1) ** 2, axis=1))
