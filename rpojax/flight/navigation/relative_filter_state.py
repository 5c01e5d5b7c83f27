"""State of the relative orbit filter: the target's motion from the servicer, and slow states declared by name.

A slow state is one that changes by itself and by nothing else: the target's apparent size, the bearing bias of the
camera, the lasting errors of burns, the difference of drag. Each is declared here once, with its prior, its transition
and process noise, and how it acts on the motion; filter, sharing, linear covariance and records find it by its name.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.filter_state_layout import MOTION, StateLayout
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply, line_of_sight_rate
from rpojax.flight.navigation import burn_execution_error, outline_correlation, shape_errors, target_attitude_ekf
from rpojax.flight.navigation.lasting_error_effects import LastingEffects
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation
from rpojax.flight.navigation.shape_errors import ShapeErrors
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget, TargetAttitude

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@dataclass(frozen=True)
class SlowState:
    """Declaration of a slow state: a Gauss-Markov process, a random walk or a constant.

    Attributes:
        name: of its block
        size: how many numbers it has
        unit: of each
        prior_variance: (size,) at hand-over, of the tuning and of the target's position from the servicer [m]
        process: factor (size,) on the state over a time [s], and process variance (size,), of the tuning and of the
            errors that come from the target's shape
        burn_effect: (3, size) velocity change of the servicer that a unit of the state adds to a burn of a velocity
            change (3,) [m/s], linear in it; None for a state that burns do not show
        acceleration: (3, size) of the target from the servicer by a unit of the state [m/s^2]; None for a state
            without effect on it
        is_lasting: it stays as it was at hand-over, but for a slow walk, and so far as it was declared
        sensor: additional sensor that shows it and without which there is no such state, None for a state of all
    """

    name: str
    size: int
    unit: str
    prior_variance: Callable[[OrbitFilterTuning, Vector], Array]
    process: Callable[[OrbitFilterTuning, ShapeErrors, float | Scalar], tuple[Array, Array]]
    burn_effect: Callable[[LastingEffects, Vector], Array] | None = None
    acceleration: Callable[[LastingEffects], Array] | None = None
    is_lasting: bool = False
    sensor: str | None = None

    @property
    def acts_on_motion(self) -> bool:
        """Whether the target's motion from the servicer shows it, and not only a measurement."""
        return self.burn_effect is not None or self.acceleration is not None


SIGMA_MARGIN: Final = math.sqrt(8.0 / 6.0)
"""Factor on the declared sigma of an error that lasts: that of Student's t with eight degrees of freedom, the error of
a unit whose sigma was estimated from nine others (Gelman et al., Bayesian Data Analysis, 2013, section 3.2). A
hardware three sigma off lies at 2.6 sigma of the filter, which it need not notice to be right about itself."""


def lasting_variance(sigma: Scalar) -> Scalar:
    """Prior variance of an error that lasts, by its declared 1 sigma."""
    return (SIGMA_MARGIN * sigma) ** 2


def _constant(size: int) -> Callable[[OrbitFilterTuning, ShapeErrors, float | Scalar], tuple[Array, Array]]:
    """Process of a state that stays."""
    return lambda tuning, errors, dt: (
        jnp.ones(size, dtype=tuning.scale_sigma.dtype),
        jnp.zeros(size, dtype=tuning.scale_sigma.dtype),
    )


def _size_process(tuning: OrbitFilterTuning, errors: ShapeErrors, dt: float | Scalar) -> tuple[Array, Array]:
    decay = jnp.exp(-dt / errors.scale_time_constant)
    return decay, errors.scale_variance * (1.0 - decay**2)


def _bearing_bias_process(tuning: OrbitFilterTuning, errors: ShapeErrors, dt: float | Scalar) -> tuple[Array, Array]:
    walk = errors.bearing_process_variance * dt
    return jnp.ones(2, dtype=walk.dtype), jnp.full(2, walk)


def _center_offset_process(tuning: OrbitFilterTuning, errors: ShapeErrors, dt: float | Scalar) -> tuple[Array, Array]:
    one = jnp.ones(2, dtype=errors.center_variance.dtype)
    decay = one * jnp.exp(-dt / errors.center_time_constant)
    return decay, errors.center_variance * one * (1.0 - decay**2)


def _deflected(effects: LastingEffects, delta_v_N: Vector) -> Float[Array, "3 2"]:
    """Velocity change across a burn of `delta_v_N` [m/s] by a unit of each angle of its direction."""
    along, *across = effects.thrust_axes_N
    return jnp.sum(along * delta_v_N, axis=0) * jnp.stack(across, axis=1)


def _nearest_surface_variance(tuning: OrbitFilterTuning) -> Float[Array, "2"]:
    return (tuning.target_size * tuning.nearest_surface_sigma) ** 2 + _by_size(tuning, tuning.nearest_surface, 2)


def _centroid_variance(tuning: OrbitFilterTuning) -> Float[Array, "6"]:
    along_and_across = (tuning.target_size * tuning.centroid_sigma[jnp.array([0, 1, 2, 2, 3, 3])]) ** 2
    return along_and_across + _by_size(tuning, tuning.centroid, 6)


def _by_size(tuning: OrbitFilterTuning, mean: Scalar, count: int) -> Array:
    """Variances [m^2] of a mean distance by the error of the target's size, which the first part has."""
    return jnp.pad(((tuning.target_size * mean * tuning.target_size_sigma) ** 2)[None], (0, count - 1))


def _surface_process(
    variance: Callable[[OrbitFilterTuning], Array], slow: tuple[int, ...]
) -> Callable[[OrbitFilterTuning, ShapeErrors, float | Scalar], tuple[Array, Array]]:
    """Process of a place on the surface: the `slow` parts change as the line of sight turns, others as it tumbles."""

    def process(tuning: OrbitFilterTuning, errors: ShapeErrors, dt: float | Scalar) -> tuple[Array, Array]:
        stationary, times = variance(tuning), (errors.center_time_constant, errors.scale_time_constant[0])
        time_constant = jnp.stack([times[int(part in slow)] for part in range(stationary.shape[0])])
        decay = jnp.exp(-dt / time_constant)
        return decay, stationary * (1.0 - decay**2)

    return process


LANDMARK_NETWORK: Final = "landmark_network"
"""Name among the sensors of a filter whose landmarks are those of a network."""


def _network_error(name: str, unit: str, sigmas: Callable[[OrbitFilterTuning], Float[Array, "2"]]) -> SlowState:
    """An error of a landmark network in the axes of the camera, which changes as the target turns before it.

    `sigmas` are its 1 sigma of the first two axes, and of the third.
    """

    def stationary(tuning: OrbitFilterTuning) -> Vector:
        return sigmas(tuning)[jnp.array([0, 0, 1])] ** 2

    def process(tuning: OrbitFilterTuning, errors: ShapeErrors, dt: float | Scalar) -> tuple[Array, Array]:
        assert errors.landmark_decay_rate is not None
        variance = stationary(tuning)
        decay = jnp.exp(-dt * errors.landmark_decay_rate) * jnp.ones_like(variance)
        return decay, variance * (1.0 - decay**2)

    return SlowState(name, 3, unit, lambda tuning, r_TS_N: stationary(tuning), process, sensor=LANDMARK_NETWORK)


SENSOR_STATES = (
    # Of the surface that a range finder meets from where it is on average, towards the servicer; slow and fast part.
    SlowState(
        "nearest_surface",
        2,
        "m",
        lambda tuning, r_TS_N: _nearest_surface_variance(tuning),
        _surface_process(_nearest_surface_variance, slow=(0,)),
        sensor="range_finder",
    ),
    # Of the centroid of a LiDAR's returns from where it is on average: towards the servicer, slow and fast part, and
    # along two axes across the line of sight, slow and fast part of both.
    SlowState(
        "centroid",
        6,
        "m",
        lambda tuning, r_TS_N: _centroid_variance(tuning),
        _surface_process(_centroid_variance, slow=(0, 2, 3)),
        sensor="lidar",
    ),
    # Small turn of the target's attitude from its reference, in T. The rate changes it: `target_attitude_ekf`.
    SlowState(
        "attitude",
        3,
        "rad",
        lambda tuning, r_TS_N: jnp.ones(3, dtype=r_TS_N.dtype),
        _constant(3),
        sensor="landmarks",
    ),
    # Of the target, in T.
    SlowState(
        "rate",
        3,
        "rad/s",
        lambda tuning, r_TS_N: jnp.full(3, tuning.tumble_sigma**2),
        lambda tuning, errors, dt: (
            jnp.ones(3, dtype=tuning.tumble_walk.dtype),
            jnp.full(3, tuning.tumble_walk**2 * dt),
        ),
        sensor="landmarks",
    ),
    # Log of the first and the second moment of inertia over their nominal values, as ratios to the third.
    SlowState(
        "inertia_ratio",
        2,
        "-",
        lambda tuning, r_TS_N: jnp.full(2, lasting_variance(tuning.inertia_ratio_sigma)),
        _constant(2),
        sensor="landmarks",
    ),
    # Of the landmarks from where they should be about the centre of mass, in T.
    SlowState(
        "body_offset",
        3,
        "m",
        lambda tuning, r_TS_N: jnp.full(3, lasting_variance(tuning.body_offset_sigma)),
        _constant(3),
        sensor="landmarks",
    ),
    # Small turn by which all landmarks of a picture are off, about the camera's axes.
    _network_error("network_turn", "rad", lambda tuning: tuning.network_turn_sigma),
    # Place by which they are off, over the range, along the camera's axes.
    _network_error("network_place", "-", lambda tuning: tuning.network_place_sigma),
)
"""Slow states that filters have besides where they believe a sensor; they come first, as burns do not show them."""

SLOW_STATES = (
    # Log of the apparent size over its expected value, in a slow and a fast part.
    SlowState("size", 2, "-", lambda tuning, r_TS_N: shape_errors.scale_variance(tuning), _size_process),
    # Tangents in the camera.
    SlowState(
        "bearing_bias",
        2,
        "rad",
        lambda tuning, r_TS_N: jnp.full(2, lasting_variance(tuning.bearing_bias_sigma)),
        _bearing_bias_process,
        is_lasting=True,
    ),
    # Of the box centre from the centre of mass, image right and down; it wanders as the target tumbles.
    SlowState(
        "center_offset",
        2,
        "m",
        lambda tuning, r_TS_N: jnp.full(
            2, shape_errors.center_variance(tuning, jnp.zeros_like(tuning.target_size), r_TS_N)
        ),
        _center_offset_process,
    ),
    # Relative error of the velocity change of burns, lasting from burn to burn: that of thrust and mass. Taken as a new
    # error in every burn it would seem to average out, and the range that burns show would be believed too well.
    SlowState(
        "burn_scale",
        1,
        "-",
        lambda tuning, r_TS_N: lasting_variance(burn_execution_error.lasting_sigma(tuning))[None],
        _constant(1),
        burn_effect=lambda effects, delta_v_N: delta_v_N[:, None],
        is_lasting=True,
    ),
    # Angles of the thrust from its nominal direction, about which the thruster's mounting and plume are known.
    SlowState(
        "thrust_direction",
        2,
        "rad",
        lambda tuning, r_TS_N: jnp.full(2, lasting_variance(burn_execution_error.lasting_direction_sigma(tuning))),
        _constant(2),
        burn_effect=_deflected,
        is_lasting=True,
    ),
    # Area over mass of the target less that of the servicer, by which air and sunlight push them apart.
    SlowState(
        "ballistic",
        1,
        "m^2/kg",
        lambda tuning, r_TS_N: lasting_variance(tuning.ballistic_sigma)[None],
        _constant(1),
        acceleration=lambda effects: effects.ballistic_N[:, None],
        is_lasting=True,
    ),
)
"""Slow states of every filter, in the order of its vector."""

VIEW_STATES = tuple(state for state in SLOW_STATES if not state.acts_on_motion)
"""Those that a box shows: the states of filters that take the errors of burns as new in each burn."""


def states_with(sensors: Collection[str], states: tuple[SlowState, ...] = SLOW_STATES) -> tuple[SlowState, ...]:
    """These slow states of a filter that believes the additional sensors of these names, and those of the sensors."""
    return (*(state for state in SENSOR_STATES if state.sensor in sensors), *states)


def _declared() -> tuple[SlowState, ...]:
    """All slow states in the order of the vector."""
    return (*SENSOR_STATES, *SLOW_STATES)


@cache
def layout_of(names: frozenset[str]) -> StateLayout:
    """Layout of the motion and the slow states of these names."""
    return StateLayout((*MOTION.blocks, *((state.name, state.size) for state in _declared() if state.name in names)))


@pytree
class RelativeEstimate:
    """Mean and covariance of the relative state.

    Attributes:
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        slow: slow states by name
        covariance: (n, n) in the order of `layout`
        outline: how fast the outline changes, by which the errors of size and centre lose their correlation
        target: attitude that the slow state `attitude` is measured from, None without landmarks
    """

    r_TS_N: Array
    v_TS_N: Array
    slow: dict[str, Array]
    covariance: Array
    outline: OutlineCorrelation
    target: TargetAttitude | None = None

    @property
    def layout(self) -> StateLayout:
        """Names of the blocks of its vector."""
        return layout_of(frozenset(self.slow))

    @property
    def vector(self) -> Float[Array, " n"]:
        """Mean in the order of `layout`."""
        return self.layout.vector(position=self.r_TS_N, velocity=self.v_TS_N, **self.slow)

    @property
    def motion_covariance(self) -> Float[Array, "6 6"]:
        """Covariance of position and velocity [m, m/s]."""
        return self.covariance[: MOTION.size, : MOTION.size]

    @property
    def attitude_sigma(self) -> Scalar:
        """1-sigma of the attitude of the target about the least known axis of T [rad], infinite if not certain."""
        if self.target is None:
            return jnp.full_like(self.covariance[0, 0], jnp.inf)
        place = self.layout["attitude"]
        variance = jnp.max(jnp.diagonal(self.covariance)[place], axis=0)
        return jnp.where(self.target.certain, jnp.sqrt(variance), jnp.inf)

    @property
    def position_covariance(self) -> Float[Array, "3 3"]:
        """Covariance of the position [m^2]."""
        place = MOTION["position"]
        return self.covariance[place, place]


def initial_sigma(tuning: OrbitFilterTuning) -> Float[Array, "6"]:
    """1-sigma of position and velocity at hand-over."""
    return MOTION.vector(
        position=jnp.full(3, tuning.initial_relative_position_sigma),
        velocity=jnp.full(3, tuning.initial_relative_velocity_sigma),
    )


def initial(
    tuning: OrbitFilterTuning,
    r_TS_N: Vector,
    v_TS_N: Vector,
    states: tuple[SlowState, ...] = SLOW_STATES,
    target: BelievedTarget | None = None,
) -> RelativeEstimate:
    """Estimate at hand-over with position [m] and velocity [m/s] as means, and these slow states.

    With `target` its attitude is estimated, too.
    """
    variance = [state.prior_variance(tuning, r_TS_N) for state in states]
    return RelativeEstimate(
        r_TS_N=r_TS_N,
        v_TS_N=v_TS_N,
        slow={state.name: jnp.zeros(state.size, dtype=r_TS_N.dtype) for state in states},
        covariance=jnp.diag(jnp.concatenate([initial_sigma(tuning) ** 2, *variance])),
        outline=outline_correlation.initial(),
        target=None if target is None else target_attitude_ekf.unknown(target, _has_network(states)),
    )


def _has_network(states: tuple[SlowState, ...]) -> bool:
    return any(state.sensor == LANDMARK_NETWORK for state in states)


def moved_to(
    estimate: RelativeEstimate, vector: Float[Array, " n"], covariance: Float[Array, "n n"]
) -> RelativeEstimate:
    """Estimate with another mean, in the order of its layout, and covariance."""
    blocks = estimate.layout.split(vector)
    position, velocity = blocks.pop("position"), blocks.pop("velocity")
    return replace(estimate, r_TS_N=position, v_TS_N=velocity, slow=blocks, covariance=covariance)


def corrected(
    estimate: RelativeEstimate, deviation: Float[Array, " n"], covariance: Float[Array, "n n"]
) -> RelativeEstimate:
    """Estimate with the correction of an update added to its mean, and the covariance after it."""
    change = estimate.layout.split(deviation)
    return replace(
        estimate,
        r_TS_N=estimate.r_TS_N + change["position"],
        v_TS_N=estimate.v_TS_N + change["velocity"],
        slow={name: value + change[name] for name, value in estimate.slow.items()},
        covariance=covariance,
    )


def reset_to_prior(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, names: Collection[str], where: Bool[Array, ""]
) -> RelativeEstimate:
    """Estimate whose slow states of these names are as at hand-over, and of which nothing else knows, if `where`."""
    layout, variances = estimate.layout, {}
    for state in _declared():
        if state.name in names:
            variances[state.name] = jnp.where(where, state.prior_variance(tuning, estimate.r_TS_N), 0.0)
    kept = 1.0 - layout.vector(
        **{name: jnp.where(where, 1.0, jnp.zeros_like(each)) for name, each in variances.items()}
    )
    slow = {
        name: jnp.where(where, jnp.zeros_like(value), value) if name in variances else value
        for name, value in estimate.slow.items()
    }
    covariance = estimate.covariance * (kept[:, None] * kept[None, :]) + jnp.diag(layout.vector(**variances))
    return replace(estimate, slow=slow, covariance=covariance)


def process_variances(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, names: Sequence[str], dt: float | Scalar
) -> dict[str, Array]:
    """Process variances over `dt` [s] of the slow states of these names."""
    errors = _shape_errors(tuning, estimate, estimate.r_TS_N, estimate.v_TS_N)
    return {state.name: state.process(tuning, errors, dt)[1] for state in SLOW_STATES if state.name in names}


def _shape_errors(tuning: OrbitFilterTuning, estimate: RelativeEstimate, r_TS_N: Vector, v_TS_N: Vector) -> ShapeErrors:
    time_constant = outline_correlation.correlation_time(estimate.outline)
    errors = shape_errors.shape_errors(tuning, time_constant, estimate.slow["size"][0], r_TS_N, v_TS_N)
    return replace(errors, landmark_decay_rate=landmark_decay_rate(tuning, estimate, r_TS_N, v_TS_N))


def landmark_decay_rate(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, r_TS_N: Vector, v_TS_N: Vector
) -> Scalar | None:
    """Rate [1/s] at which the errors of a landmark network become others, None without one.

    It is by how fast a target turns from the line of sight that is at `r_TS_N` [m] and moves by `v_TS_N` [m/s].
    """
    if "network_turn" not in estimate.slow:
        return None
    assert estimate.target is not None
    q_NT = quaternion.conjugate(target_attitude_ekf.attitude(estimate.target, estimate.slow))
    turning_N = quaternion.rotate(q_NT, estimate.slow["rate"]) - line_of_sight_rate(r_TS_N, v_TS_N)
    return gradient_safe.norm(turning_N) / tuning.network_angle


def slow_process(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, r_TS_N: Vector, v_TS_N: Vector, dt: float | Scalar
) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Factors on the slow states over `dt` [s], and their process variances.

    The target is at `r_TS_N` [m] from the servicer and moves by `v_TS_N` [m/s].
    """
    errors = _shape_errors(tuning, estimate, r_TS_N, v_TS_N)
    pairs = [state.process(tuning, errors, dt) for state in _declared() if state.name in estimate.slow]
    return jnp.concatenate([decay for decay, _ in pairs]), jnp.concatenate([variance for _, variance in pairs])


def velocity_effects(
    layout: StateLayout, effects: LastingEffects, delta_v_N: Vector, dt: float | Scalar
) -> Float[Array, "3 m"] | None:
    """Velocity change of the target from the servicer over `dt` [s] by a unit of each slow state that acts on it.

    These states are the last ones of the layout; None if no state acts on it. Meanwhile the servicer burns by
    `delta_v_N` [m/s].
    """
    columns = []
    for state in SLOW_STATES:
        if state.name in layout and state.burn_effect is not None:
            columns.append(-state.burn_effect(effects, delta_v_N))
        if state.name in layout and state.acceleration is not None:
            columns.append(dt * state.acceleration(effects))
    return jnp.concatenate(columns, axis=1) if columns else None


def expected_delta_v(estimate: RelativeEstimate, effects: LastingEffects, delta_v_N: Vector) -> Vector:
    """Velocity change (3,) [m/s] of a burn with the estimated errors that last from burn to burn."""
    states = [state for state in SLOW_STATES if state.name in estimate.slow]
    added = [apply(by(effects, delta_v_N), estimate.slow[each.name]) for each in states if (by := each.burn_effect)]
    return sum(added, delta_v_N)


def lasting_acceleration(estimate: RelativeEstimate, effects: LastingEffects) -> Vector:
    """Estimated acceleration (3,) [m/s^2] of the target from the servicer by what pushes them apart."""
    states = [state for state in SLOW_STATES if state.name in estimate.slow]
    found = [apply(by(effects), estimate.slow[each.name]) for each in states if (by := each.acceleration)]
    return sum(found, jnp.zeros_like(estimate.r_TS_N))


def reopening_factor(reopened: Bool[Array, ""]) -> Scalar:
    """Factor on the sigma of position and velocity of an estimate that a failed search has reopened, else 1."""
    return jnp.where(reopened, jnp.sqrt(_WIDENING), 1.0)


def reopen(estimate: RelativeEstimate, reopened: Bool[Array, ""]) -> RelativeEstimate:
    """Estimate with twice the variance of position and velocity if the target is not where it should be."""
    factor = reopening_factor(reopened)
    rest = jnp.ones(estimate.layout.size - MOTION.size, dtype=factor.dtype)
    factors = jnp.concatenate([jnp.full(MOTION.size, factor), rest])
    return replace(estimate, covariance=estimate.covariance * (factors[:, None] * factors[None, :]))


_WIDENING = 2.0
"""Factor on the variance of position and velocity after a search of all directions that they allow. A choice: the sigma
doubles with every second search."""
