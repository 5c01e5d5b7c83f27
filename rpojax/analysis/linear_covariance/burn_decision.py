"""Burn decision in a linear covariance: its describing function, and the execution errors of its burns."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.analysis.linear_covariance import describing_function
from rpojax.analysis.linear_covariance.linearisation.compiled_loop import CompiledLoop
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import LinearisationPoint
from rpojax.physics.thruster import Thruster


@dataclass(frozen=True)
class BurnDecision:
    """A burn decision, statistically linearised.

    Attributes:
        command_jacobian: (3, size + inputs) of the control law's output
        linearisation: from that output to velocity change and its size, less the nominal ones
        burns: (samples, 3) velocity changes of the samples [m/s]
        nominal_burn: (3,) that of the nominal run [m/s]
        probability: of a burn
        mean_size: of the velocity change, zero without a burn included [m/s]
        look_away: (2,) begin and end of the look-away for a burn, from the decision on [s]
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
    points: LinearisationPoint,
    command_jacobian: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    normal_points: np.ndarray,
) -> BurnDecision:
    """Decision at the first linearisation point, for a command of the control law of that mean (3,) and covariance.

    `command_jacobian` is that of the command, `normal_points` (samples, 3) are those of the describing function.
    """
    memory = jax.tree.map(lambda leaf: leaf[0], points.memory)
    tick = points.state.tick[0]
    nominal = np.asarray(memory.plan.delta_v_N)
    look_away: list[np.ndarray] = []

    def burn_deviations(commands: np.ndarray) -> np.ndarray:
        burns, times = compiled.burns_for_commands(memory, tick, jnp.asarray(commands))
        look_away.append(np.asarray(times))
        sizes = np.linalg.norm(burns, axis=1) - np.linalg.norm(nominal)
        return np.concatenate([np.asarray(burns) - nominal, sizes[:, None]], axis=1)

    found = describing_function.statistical_linearisation(burn_deviations, mean, covariance, normal_points)
    sizes = found.outputs[:, 3] + np.linalg.norm(nominal)
    burning = sizes > 0.0
    now = float(tick) * compiled.loop.scenario.tick_s
    return BurnDecision(
        command_jacobian=command_jacobian,
        linearisation=found,
        burns=found.outputs[:, :3] + nominal,
        nominal_burn=nominal,
        probability=float(burning.mean()),
        mean_size=float(sizes.mean()),
        look_away=look_away[0][burning].mean(axis=0) - now if np.any(burning) else np.zeros(2),
    )


def execution_error_columns(decision: BurnDecision, thruster: Thruster, along: float, across: float) -> np.ndarray:
    """Noise columns (3, 3) [m/s] of the execution error of the nominal burn, or where there is none, of the samples'.

    A run whose burn is a percent too strong also moves a percent more in that direction; along a nominal run that moves
    otherwise the same error would have a larger effect. So the error is that of the nominal burn, and constant errors
    are in the Jacobian. Without a nominal burn the burns go in all directions, and constant errors, of variance `along`
    and `across` the burn, count like noise.
    """
    nominal = np.any(decision.nominal_burn)
    burns = decision.nominal_burn[None, :] if nominal else decision.burns
    moment = burns.T @ burns / len(burns)
    constant = np.zeros((3, 3)) if nominal else moment
    noise = _error_covariance(moment, float(thruster.magnitude_noise) ** 2, float(thruster.direction_noise) ** 2)
    return covariance_root(noise + _error_covariance(constant, along, across))


def covariance_root(covariance: np.ndarray) -> np.ndarray:
    """Square root (n, n) of a covariance: columns of unit variance."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _error_covariance(moment: np.ndarray, along: float, across: float) -> np.ndarray:
    """Covariance (3, 3) of errors of burns with that second moment: variances along them, and across per axis."""
    return along * moment + across * (np.trace(moment) * np.eye(3) - moment)
