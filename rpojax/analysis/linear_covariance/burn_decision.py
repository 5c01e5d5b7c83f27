"""Burn decision in a linear covariance: its describing function, and the execution errors of its burns.

Describing function (statistical linearisation): the linear function of least mean square error over a normal input.

CADET (Gelb and Warren, "Direct statistical analysis of nonlinear systems: CADET", AIAA Journal 11, 1973): a normal
input through a nonlinearity is replaced by mean, gain and residual of least mean square error. The expectations are
means over a fixed set of quasi-random normal numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from rpojax.analysis.linear_covariance.linearisation.compiled_loop import CompiledLoop
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import LinearisationPoint
from rpojax.physics.thruster import Thruster
from rpojax.scenario.sections import CameraSection
from rpojax.scenario.static_settings import Scenario


@dataclass(frozen=True)
class StatisticalLinearisation:
    """Linearisation of a vector function of a normal vector, `f(u) = mean + gain (u - E u) + residual`.

    Attributes:
        mean: (m,) of f
        gain: (m, n)
        residual: (m, m) covariance of the residual, uncorrelated with u
        inputs: (samples, n) sampled values of u
        outputs: (samples, m) f there
    """

    mean: np.ndarray
    gain: np.ndarray
    residual: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


def normal_points(dimension: int, power: int) -> np.ndarray:
    """Quasi-random standard normal numbers (2**power, dimension), with mean 0 and unit covariance."""
    points = ndtri(qmc.Sobol(dimension, scramble=True, rng=0).random_base2(power))
    points = points - points.mean(axis=0)
    root = np.linalg.cholesky(points.T @ points / len(points))
    return np.linalg.solve(root, points.T).T


def statistical_linearisation(
    function: Callable[[np.ndarray], np.ndarray], mean: np.ndarray, covariance: np.ndarray, points: np.ndarray
) -> StatisticalLinearisation:
    """Linearises `function`, from (samples, n) to (samples, m), over a normal input at standard normal `points`."""
    values, vectors = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(values, 0.0))
    inputs = mean + points * sigma @ vectors.T
    outputs = function(inputs)
    centre = outputs.mean(axis=0)
    cross_moment = (outputs - centre).T @ points / len(points)
    residual = outputs - centre - points @ cross_moment.T
    # A direction in which the input does not vary does not enter the gain.
    inverse = np.where(sigma > 1e-12 * max(sigma.max(), 1e-300), 1.0 / np.maximum(sigma, 1e-300), 0.0)
    return StatisticalLinearisation(
        mean=centre,
        gain=cross_moment * inverse @ vectors.T,
        residual=residual.T @ residual / len(points),
        inputs=inputs,
        outputs=outputs,
    )


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
    linearisation: StatisticalLinearisation
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

    found = statistical_linearisation(burn_deviations, mean, covariance, normal_points)
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


class BoxSchedule:
    """Which frames of successive burn periods may have a box.

    A frame is left out whenever the expected number of misses has grown by one, and the look-away of a burn whenever
    the expected number of burns that the nominal run does not make has.
    """

    def __init__(self, scenario: Scenario, camera: CameraSection) -> None:
        self._scenario = scenario
        self._miss_rate = 1.0 - (1.0 - camera.miss_probability) * (1.0 - camera.outlier_probability)
        self._expected_misses, self._expected_burns = 0.0, 0.0

    def next_period(self, last: BurnDecision | None) -> np.ndarray:
        """Flags (ticks,) of the next period's frames, after its predecessor's burn decision."""
        allowed = np.ones(self._scenario.formation_ticks, dtype=bool)
        for tick in range(len(allowed)):
            self._expected_misses += self._miss_rate
            allowed[tick] = self._expected_misses < 1.0
            self._expected_misses -= 0.0 if allowed[tick] else 1.0
        if last is not None and not np.any(last.nominal_burn):
            self._expected_burns += last.probability
            if self._expected_burns >= 1.0:
                self._expected_burns -= 1.0
                times = np.arange(len(allowed)) * self._scenario.tick_s
                allowed &= (times < last.look_away[0]) | (times >= last.look_away[1])
        return allowed
