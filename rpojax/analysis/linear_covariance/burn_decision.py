"""A burn decision in a linear covariance: its describing function, and the execution errors of the burns it makes."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.linear_covariance import describing_function
from rpojax.analysis.linear_covariance.linearised_loop import CompiledLoop, LinearisationPoint
from rpojax.physics.actuators import Thruster


@dataclass(frozen=True)
class BurnDecision:
    """A burn decision, linearised.

    Attributes:
        law: (3, size + inputs) derivative of the control law's output
        found: the decision from that output to velocity change and its size, less the nominal ones
        burns: (samples, 3) velocity changes that runs make [m/s]
        nominal: (3,) that of the nominal run
        probability: of a burn
        size: mean size of its velocity change [m/s]
        away: (2,) from when to when a run that burns looks away, from the decision on [s]
    """

    command_jacobian: np.ndarray
    linearisation: describing_function.StatisticalLinearisation
    burns: np.ndarray
    nominal_burn: np.ndarray
    probability: float
    mean_size: float
    look_away: np.ndarray


def linearise_decision(
    compiled: CompiledLoop,
    moments: LinearisationPoint,
    law: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    points: np.ndarray,
) -> BurnDecision:
    """The decision on the first of the moments, where the control law's output has that mean (3,) and covariance.

    `law` is the output's derivative and `points` are the normal ones of the describing function.
    """
    memory = jax.tree.map(lambda leaf: leaf[0], moments.memory)
    tick = moments.state.tick[0]
    nominal = np.asarray(memory.plan.delta_v_N)
    away: list[np.ndarray] = []

    def burn(laws: np.ndarray) -> np.ndarray:
        burns, times = compiled.burns_for_commands(memory, tick, jnp.asarray(laws))
        away.append(np.asarray(times))
        sizes = np.linalg.norm(burns, axis=1) - np.linalg.norm(nominal)
        return np.concatenate([np.asarray(burns) - nominal, sizes[:, None]], axis=1)

    found = describing_function.statistical_linearisation(burn, mean, covariance, points)
    sizes = found.outputs[:, 3] + np.linalg.norm(nominal)
    made = sizes > 0.0
    return BurnDecision(
        command_jacobian=law,
        linearisation=found,
        burns=found.outputs[:, :3] + nominal,
        nominal_burn=nominal,
        probability=float(made.mean()),
        mean_size=float(sizes.mean()),
        look_away=away[0][made].mean(axis=0) - float(tick) * compiled.loop.scenario.tick_s
        if np.any(made)
        else np.zeros(2),
    )


def execution_error_columns(decision: BurnDecision, thruster: Thruster, along: float, across: float) -> np.ndarray:
    """Columns (3, 3) [m/s] of the execution error of the nominal burn, or where there is none, of those that runs make.

    A run whose burn is a percent too strong in some direction also moves in that direction, and takes a percent
    more of range for it; along a nominal run that moves otherwise the same error would do more. So the error is
    that of the nominal burn, and what lasts from burn to burn is then in the derivative. Without a nominal burn the
    burns go in all directions, and what lasts, of variance `along` and `across` the burn, counts like noise.
    """
    nominal = np.any(decision.nominal_burn)
    burns = decision.nominal_burn[None, :] if nominal else decision.burns
    moment = burns.T @ burns / len(burns)
    beyond = np.zeros((3, 3)) if nominal else moment
    covariance = _spread(moment, float(thruster.magnitude_noise) ** 2, float(thruster.direction_noise) ** 2)
    return covariance_root(covariance + _spread(beyond, along, across))


def covariance_root(covariance: np.ndarray) -> np.ndarray:
    """Columns (n, n) of unit variance that make up a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _spread(moment: np.ndarray, along: float, across: float) -> np.ndarray:
    """Covariance (3, 3) of errors of burns with the given second moment: shares along them, and across per axis."""
    return along * moment + across * (np.trace(moment) * np.eye(3) - moment)
