"""Where the nominal runs of a linear covariance begin, and what deviates there."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.linear_covariance.deviation_vector import DeviationLayout
from rpojax.analysis.linear_covariance.dispersion_linearisation import LinearisedDispersions
from rpojax.analysis.linear_covariance.tick_noise_vector import GPS_BIAS, GYRO, GYRO_BIAS, HANDOVER, STAR_TRACKER
from rpojax.dispersions import dispersed_values
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import closed_loop
from rpojax.simulation.noise import InitialNoise

_POSITION, _VELOCITY = "initial.relative_position_m", "initial.relative_velocity_m_s"


@dataclass(frozen=True)
class InitialCondition:
    """Where a nominal run begins, and what deviates there.

    Attributes:
        state: of the loop
        columns: name of the source -> (size, inputs) deviations of the vector per sigma
        mean: (size,) of the vector over all runs, less that of the nominal run
    """

    state: closed_loop.State
    columns: dict[str, np.ndarray]
    mean_offset: np.ndarray


def initial_conditions(
    scenario: Scenario, params: Params, layout: DeviationLayout, key: Array, found: LinearisedDispersions
) -> list[InitialCondition]:
    """Two nominal runs, one on either side of the mean; their covariances are averaged.

    They start one sigma beside the mean across the line of sight: what bearings tell of the range grows with the square
    of how far a run is off, so that the two learn as much as runs do in the mean, and their errors are turned as much
    out of the axes of H. Where no place is dispersed, the mean run is all there is.
    """
    names, widths = [*found.columns], [next(iter(each.values())).shape[1] for each in found.columns.values()]
    noise = {HANDOVER: 12, GPS_BIAS: 3, GYRO_BIAS: 3, STAR_TRACKER: 3, GYRO: 3}
    edges = np.cumsum([0, *widths, *noise.values()])
    parts = {name: slice(*edges[i : i + 2]) for i, name in enumerate([*names, *noise])}

    def begin(inputs: Array, centre: Mapping[str, Array]) -> tuple[Array, closed_loop.State]:
        values = dict(centre)
        for name in names:
            for key_of, change in found.columns[name].items():
                moved = jnp.sum(jnp.asarray(change) * inputs[parts[name]][None, :], axis=1)
                values[key_of] = values[key_of] + moved.reshape(values[key_of].shape)
        chosen = dispersed_values.apply_to_params(params, values)
        drawn = InitialNoise(
            biases=jnp.concatenate([inputs[parts[GPS_BIAS]], inputs[parts[GYRO_BIAS]]]),
            box_edge_errors=None,
            handover=inputs[parts[HANDOVER]],
            star_tracker=inputs[parts[STAR_TRACKER]],
            gyro=inputs[parts[GYRO]],
        )
        state = closed_loop.init(scenario, chosen, key, drawn)
        return layout.pack(state, chosen), state

    derive = jax.jit(lambda inputs, centre: (jax.jacfwd(begin, has_aux=True)(inputs, centre), begin(inputs, centre)[0]))
    zero = jnp.zeros(int(edges[-1]))
    mean = {key_of: jnp.asarray(value) for key_of, value in found.mean.items()}
    middle = np.asarray(derive(zero, mean)[1])
    until_s = scenario.formation_period_s + float(params.flight.formation.lead)
    rho_H = np.asarray(params.initial.relative_position)
    result = []
    for side in (1.0, -1.0) if {_POSITION, _VELOCITY} & {*mean} else (0.0,):
        off = {key_of: jnp.asarray(value) for key_of, value in _beside(found, rho_H, side, until_s).items()}
        (jacobian, state), vector = derive(zero, mean | off)
        columns = {name: np.asarray(jacobian)[:, part] for name, part in parts.items()}
        result.append(InitialCondition(state, columns, middle - np.asarray(vector)))
    return result


def _beside(found: LinearisedDispersions, rho_H: np.ndarray, side: float, until_s: float) -> dict[str, np.ndarray]:
    """Place and velocity off the mean across the line of sight along `rho_H`, on one `side` (1 or -1).

    Place and velocity are drawn apart, so that the distance grows as the root of the sum of their squares; a straight
    line from the start to `until_s` stands for that.
    """
    position, velocity = (_sigma(found, key) for key in (_POSITION, _VELOCITY))
    speed = (np.hypot(position, velocity * until_s) - position) / until_s
    line = rho_H / np.linalg.norm(rho_H)
    # The free motion takes place in the orbit plane and has a side of its own; across it there is none.
    sides = np.array([side, side, 1.0])
    off = {_POSITION: sides * position, _VELOCITY: sides * speed}
    return {key: found.mean[key] + each - line * (line @ each) for key, each in off.items() if key in found.mean}


def _sigma(found: LinearisedDispersions, key: str) -> np.ndarray:
    """(3,) standard deviations of a dispersed vector, zero if it is not."""
    changes = [each[key] for each in found.columns.values() if key in each]
    return np.sqrt(np.sum(np.concatenate([*changes, np.zeros((3, 1))], axis=1) ** 2, axis=1))
