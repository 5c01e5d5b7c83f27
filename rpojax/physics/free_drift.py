"""Free drift: least range of the servicer from the target after a loss of thrust, under the plant's own forces.

All drifts of a run share the target's orbit. Over a step the relative motion about this orbit is an affine function of
relative state and inverse mass, whose coefficients come from one eighth-order Runge-Kutta step for all drifts. What is
not affine acts as impulses at both ends of the step (Strang, "On the construction and comparison of difference
schemes", 1968). The sunlit fraction is that of the target.
"""

from dataclasses import dataclass
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from rpojax.batching import batching_mode
from rpojax.core.numerics import runge_kutta
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.orbits import zonal_gravity
from rpojax.core.orbits.closest_approach import Approach, closest_approach, entry_place, least_square_until
from rpojax.core.orbits.sun_moon_ephemeris import Epoch, SunMoonPositions, sun_and_moon_at
from rpojax.core.pytree import pytree, replace
from rpojax.physics import forces_and_torques
from rpojax.physics.environment.solar_radiation_pressure import sunlit_fraction
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import Motion, PlantParams, Truth

Scalar = Float[Array, ""]
Integer = Int[Array, ""]
Vector = Float[Array, "3"]
Affine = Float[Array, "6 8"]

STEP_S: Final = 240.0
"""Step of the propagation [s]: least ranges over a day of `inspection_full` are 0.5 mm off, with half of it 0.01 mm,
with twice 46 mm; against the plant in experiments/passive_safety."""
_SHORTEST_S = 1e-30
"""Stands for the length of an empty interval, as it is divided by [s]."""
_SHADOW_SAMPLES = 48
"""Samples of the sunlit fraction in a step: least ranges over a day of `inspection_eclipse` are 0.07 mm off, with half
as many 0.35 mm."""


@pytree
class Drift:
    """Start of a free drift, and the times until which it is followed; a further axis at the end for several.

    Attributes:
        start: () time since the start of the run [s]
        r_ST_N: (3,) servicer from target at the start [m]
        v_ST_N: (3,) its inertial derivative [m/s]
        mass: () of the servicer [kg]
        thrust_s: () how long a thruster stays open from the start, at most `STEP_S` [s]
        acceleration_N: (3,) by that thruster [m/s^2]
        ends: (horizons,) times at which the horizons end [s]
    """

    start: Array
    r_ST_N: Array
    v_ST_N: Array
    mass: Array
    thrust_s: Array
    acceleration_N: Array
    ends: Array


@pytree
class DriftRange:
    """What a drift comes to; a further axis at the end for several.

    Attributes:
        least_square: (horizons,) least squared range from the start to the end of each horizon [m^2]
        entry: () time of the first entry into the keep-out sphere [s], infinite if there is none
    """

    least_square: Array
    entry: Array


@dataclass(frozen=True)
class Environment:
    """Forces on the two vehicles of a run.

    Attributes:
        effects: switches of the plant
        params: true parameters
        epoch: start of the run
    """

    effects: Effects
    params: PlantParams
    epoch: Epoch

    def sky(self, time: Scalar) -> SunMoonPositions:
        """Positions of Sun and Moon at a time of the run [s]."""
        return sun_and_moon_at(self.epoch, time)

    def accelerations(
        self, motion: Motion, mass: Scalar, sky: SunMoonPositions, sunlit: Scalar
    ) -> tuple[Vector, Vector]:
        """Accelerations [m/s^2] in N of the target, and of the servicer less that of the target, without thrust."""
        y = _plant_state(motion, mass)
        gravity = zonal_gravity.gravity(
            self.params.gravity, self.effects.zonal_degree, Difference(value=motion.r_TN_N, change=motion.r_ST_N)
        )
        gravity = gravity + forces_and_torques.third_body_accelerations(self.effects, y, sky)
        surface = forces_and_torques.surface_effects(self.effects, self.params, y, sky, (sunlit, sunlit))
        target = surface.target_acceleration_N
        return gravity.value + target, gravity.change + (surface.servicer_acceleration_N - target)

    def advance(self, motion: Motion, mass: Scalar, time: Scalar, dt: Scalar, acceleration_N: Vector) -> Motion:
        """Motion after a step of `dt` [s], at most `STEP_S`, under a constant acceleration by thrust [m/s^2]."""
        sky = self.sky(time + 0.5 * dt)

        def derivative(y: Motion, sunlit: Scalar) -> Motion:
            target, relative = self.accelerations(y, mass, sky, sunlit)
            return Motion(r_TN_N=y.v_TN_N, v_TN_N=target, r_ST_N=y.v_ST_N, v_ST_N=relative + acceleration_N)

        return runge_kutta.step("rk8", derivative, motion, self._sunlit_nodes(motion, sky, dt), dt)

    def _sunlit_nodes(self, motion: Motion, sky: SunMoonPositions, dt: Scalar) -> Float[Array, " nodes"]:
        """Sunlit fractions of the target at the integrator's nodes, with which its quadrature resolves the penumbra."""
        nodes = jnp.zeros(len(runge_kutta.NODES["rk8"]))
        if not self.effects.solar_pressure:
            return nodes
        r, v = motion.r_TN_N, motion.v_TN_N
        square = jnp.sum(r * r, axis=0)
        strength = self.params.gravity.mu / (square * jnp.sqrt(square))
        growth = jnp.sum(r * v, axis=0) / square
        energy = jnp.sum(v * v, axis=0) / square - strength

        def sunlit(x: Scalar) -> Scalar:
            t = x * dt
            # The f and g series (Escobal, Methods of Orbit Determination, section 3.7), 0.01 s off after a step.
            quartic = (3.0 * energy - 15.0 * growth * growth + strength) / 24.0
            f = 1.0 - strength * t * t * (0.5 - t * (0.5 * growth + t * quartic))
            g = t - strength * t * t * t * (1.0 / 6.0 - 0.25 * growth * t)
            return sunlit_fraction(self.params.sunlight, f * r + g * v, sky.sun_N)

        places = (np.arange(_SHADOW_SAMPLES) + 0.5) / _SHADOW_SAMPLES
        samples = jax.vmap(sunlit)(jnp.asarray(places))
        return jnp.sum(jnp.asarray(_node_table(places)) * samples[None, :], axis=1)


def target_orbit(environment: Environment, r_TN_N: Vector, v_TN_N: Vector, steps: int) -> Float[Array, "2 3 nodes"]:
    """Positions [m] and velocities [m/s] of the target at the ends of `steps` steps of `STEP_S`, the start included."""
    zero = jnp.zeros_like(r_TN_N)
    begin = Motion(r_TN_N=r_TN_N, v_TN_N=v_TN_N, r_ST_N=zero, v_ST_N=zero)
    mass, dt = environment.params.servicer.mass, jnp.asarray(STEP_S)

    def advance(motion: Motion, number: Array) -> tuple[Motion, Array]:
        after = environment.advance(motion, mass, number * dt, dt, zero)
        return replace(after, r_ST_N=zero, v_ST_N=zero), jnp.stack([after.r_TN_N, after.v_TN_N])

    _, nodes = jax.lax.scan(advance, begin, jnp.arange(steps, dtype=r_TN_N.dtype))
    first = jnp.stack([r_TN_N, v_TN_N])
    return jnp.moveaxis(jnp.concatenate([first[None], nodes]), 0, -1)


def motion_at(
    environment: Environment, orbit: Float[Array, "2 3 nodes"], time: Scalar, r_ST_N: Vector, v_ST_N: Vector
) -> Motion:
    """The target's orbit at a time [s] within those of `orbit`, with a relative position [m] and velocity [m/s]."""
    node = jnp.floor(time / STEP_S)
    r_TN_N, v_TN_N = orbit[:, :, node.astype(jnp.int32)]
    zero = jnp.zeros_like(r_ST_N)
    before = Motion(r_TN_N=r_TN_N, v_TN_N=v_TN_N, r_ST_N=zero, v_ST_N=zero)
    begin = node * STEP_S
    here = environment.advance(before, environment.params.servicer.mass, begin, time - begin, zero)
    return replace(here, r_ST_N=r_ST_N, v_ST_N=v_ST_N)


@pytree
class Propagation:
    """All drifts of one run at a node, with what they came to so far.

    Attributes:
        motion: relative states in the last axis; arbitrary before a drift's first node
        kick: (3, drifts) relative accelerations less their affine part [m/s^2]
        starts: (2, 3, drifts) relative states at the first nodes
        nodes: (drifts,) numbers of the first nodes
        found: ranges
    """

    motion: Motion
    kick: Array
    starts: Array
    nodes: Array
    found: DriftRange


def begin_drifts(
    environment: Environment,
    orbit: Float[Array, "2 3 nodes"],
    drifts: Drift,
    keep_out: Scalar,
    node: Integer,
) -> Propagation:
    """Drifts of one run before their propagation from a node before all starts.

    Args:
        environment: forces
        orbit: from `target_orbit`
        drifts: starts, in the last axis
        keep_out: () radius of the keep-out sphere [m]
        node: () number of the node
    """

    def begin(drift: Drift) -> tuple[DriftRange, Array, Array]:
        return _begin(environment, orbit, drift, keep_out)

    found, starts, nodes = batching_mode.transform()(begin, in_axes=-1, out_axes=-1)(drifts)
    begins = (nodes == node)[None, :]
    motion = Motion(
        r_TN_N=orbit[0, :, node],
        v_TN_N=orbit[1, :, node],
        r_ST_N=jnp.where(begins, starts[0], 0.0),
        v_ST_N=jnp.where(begins, starts[1], 0.0),
    )
    kick = _Splitting(environment).kick(motion, drifts.mass, node.astype(orbit.dtype) * STEP_S)
    return Propagation(motion=motion, kick=kick, starts=starts, nodes=nodes, found=found)


def advance_drifts(
    environment: Environment, drifts: Drift, keep_out: Scalar, node: Integer, before: Propagation
) -> Propagation:
    """Drifts of one run one step after a node, see `begin_drifts`."""
    splitting, motion = _Splitting(environment), before.motion
    time = node.astype(motion.r_TN_N.dtype) * STEP_S
    kicked = replace(motion, v_ST_N=motion.v_ST_N + 0.5 * STEP_S * before.kick)
    flowed = splitting.flow(kicked, drifts.mass, time)
    begins = (before.nodes == node + 1)[None, :]
    after = replace(
        flowed,
        r_ST_N=jnp.where(begins, before.starts[0], flowed.r_ST_N),
        v_ST_N=jnp.where(begins, before.starts[1], flowed.v_ST_N),
    )
    kick = splitting.kick(after, drifts.mass, time + STEP_S)
    after = replace(after, v_ST_N=after.v_ST_N + jnp.where(begins, 0.0, 0.5 * STEP_S * kick))

    after = fusion_barrier(after, node)
    approaches = batching_mode.transform()(lambda r, v: closest_approach(r, v, STEP_S), in_axes=-1, out_axes=-1)(
        jnp.stack([motion.r_ST_N, after.r_ST_N]), jnp.stack([motion.v_ST_N, after.v_ST_N])
    )

    def observe(approach: Approach, ends: Array, found: DriftRange) -> DriftRange:
        return _with_interval(found, approach, time, STEP_S, ends, keep_out)

    seen = batching_mode.transform()(observe, in_axes=-1, out_axes=-1)(
        fusion_barrier(approaches, node), drifts.ends, before.found
    )
    drifting = before.nodes <= node
    found = jax.tree.map(lambda new, old: jnp.where(drifting, new, old), seen, before.found)
    return replace(before, motion=after, kick=kick, found=found)


def drift_ranges(
    environment: Environment,
    orbit: Float[Array, "2 3 nodes"],
    drifts: Drift,
    keep_out: Scalar,
    first: Integer,
    last: Integer,
) -> DriftRange:
    """Ranges of drifts of one run, from a node before all starts to one after all horizons; see `begin_drifts`."""

    def advance(node: Array, before: Propagation) -> Propagation:
        return advance_drifts(environment, drifts, keep_out, node, before)

    return jax.lax.fori_loop(first, last, advance, begin_drifts(environment, orbit, drifts, keep_out, first)).found


@dataclass(frozen=True)
class _Splitting:
    """A step for all drifts of a run at once, split into its affine part and impulses."""

    environment: Environment

    def flow(self, motion: Motion, masses: Float[Array, " drifts"], time: Scalar) -> Motion:
        """Motion after a step, with relative states as an affine function of those before it."""
        r_TN_N, v_TN_N, dt = motion.r_TN_N, motion.v_TN_N, jnp.asarray(STEP_S)
        nominal = self.environment.params.servicer.mass

        def flow(x: Float[Array, "7"]) -> tuple[Float[Array, "6"], Motion]:
            before = Motion(r_TN_N=r_TN_N, v_TN_N=v_TN_N, r_ST_N=x[:3], v_ST_N=x[3:6])
            after = self.environment.advance(before, 1.0 / x[6], time, dt, jnp.zeros_like(r_TN_N))
            return jnp.concatenate([after.r_ST_N, after.v_ST_N]), after

        center = jnp.concatenate([jnp.zeros_like(x) for x in (r_TN_N, v_TN_N)] + [1.0 / nominal[None]])
        slopes, after = jax.jacfwd(flow, has_aux=True)(center)
        offset = jnp.concatenate([after.r_ST_N, after.v_ST_N])
        x = jnp.concatenate([motion.r_ST_N, motion.v_ST_N, (1.0 / masses - 1.0 / nominal)[None]])
        relative = offset[:, None] + _product(slopes, x)
        return replace(after, r_ST_N=relative[:3], v_ST_N=relative[3:])

    def kick(self, motion: Motion, masses: Float[Array, " drifts"], time: Scalar) -> Float[Array, "3 drifts"]:
        """Relative accelerations [m/s^2] less their affine part."""
        sky = self.environment.sky(time)
        nominal = self.environment.params.servicer.mass
        dark = jnp.zeros_like(nominal)

        def relative(x: Float[Array, "7"]) -> Vector:
            here = Motion(r_TN_N=motion.r_TN_N, v_TN_N=motion.v_TN_N, r_ST_N=x[:3], v_ST_N=x[3:6])
            # Sunlight acts alike on both sides of the difference.
            return self.environment.accelerations(here, 1.0 / x[6], sky, dark)[1]

        change = jnp.concatenate([motion.r_ST_N, motion.v_ST_N, (1.0 / masses - 1.0 / nominal)[None]])
        center = jnp.concatenate([jnp.zeros_like(x) for x in (motion.r_TN_N, motion.v_TN_N)] + [1.0 / nominal[None]])
        exact = batching_mode.transform()(relative, in_axes=-1, out_axes=-1)(center[:, None] + change)
        return exact - relative(center)[:, None] - _product(jax.jacfwd(relative)(center), change)


def _begin(
    environment: Environment, orbit: Float[Array, "2 3 nodes"], drift: Drift, keep_out: Scalar
) -> tuple[DriftRange, Float[Array, "2 3"], Integer]:
    """A drift up to its first node: its ranges so far, its relative state there, and the number of the node."""
    shut = drift.start + drift.thrust_s
    node = jnp.ceil(shut / STEP_S)
    motion = motion_at(environment, orbit, drift.start, drift.r_ST_N, drift.v_ST_N)

    def advance(
        before: tuple[Motion, DriftRange], interval: tuple[Array, Array, Array]
    ) -> tuple[tuple[Motion, DriftRange], None]:
        (motion, found), (time, end, acceleration_N) = before, interval
        after = environment.advance(motion, drift.mass, time, end - time, acceleration_N)
        approach = closest_approach(
            jnp.stack([motion.r_ST_N, after.r_ST_N]), jnp.stack([motion.v_ST_N, after.v_ST_N]), end - time
        )
        return (after, _with_interval(found, approach, time, end - time, drift.ends, keep_out)), None

    none = DriftRange(least_square=jnp.full_like(drift.ends, jnp.inf), entry=jnp.full_like(drift.start, jnp.inf))
    times = jnp.stack([drift.start, shut, node * STEP_S])
    accelerations_N = jnp.stack([drift.acceleration_N, jnp.zeros_like(drift.acceleration_N)])
    (motion, found), _ = jax.lax.scan(advance, (motion, none), (times[:-1], times[1:], accelerations_N))
    return found, jnp.stack([motion.r_ST_N, motion.v_ST_N]), node.astype(jnp.int32)


def _with_interval(
    found: DriftRange,
    approach: Approach,
    time: Scalar,
    duration: Scalar | float,
    ends: Float[Array, " horizons"],
    keep_out: Scalar,
) -> DriftRange:
    """Ranges with those of one more interval of `duration` from `time` [s]."""
    length = jnp.maximum(duration, _SHORTEST_S)
    shares = jnp.clip((ends - time) / length, 0.0, 1.0)
    squares = jax.vmap(lambda share: least_square_until(approach, share))(shares)
    squares = jnp.where(ends >= time, squares, jnp.inf)
    return DriftRange(
        least_square=jnp.minimum(found.least_square, squares),
        entry=jnp.minimum(found.entry, time + length * entry_place(approach, keep_out)),
    )


def _product(matrix: Float[Array, "rows 7"], vectors: Float[Array, "7 drifts"]) -> Array:
    # Term by term, so that the loop over drifts and runs is vectorised.
    return sum((matrix[:, k, None] * vectors[None, k] for k in range(1, 7)), matrix[:, 0, None] * vectors[None, 0])


def _plant_state(motion: Motion, mass: Scalar) -> Truth:
    """State of the plant of which the forces alone are asked for: attitudes do not matter to them."""
    zero, identity = jnp.zeros_like(motion.r_TN_N), jnp.array([1.0, 0.0, 0.0, 0.0], dtype=motion.r_TN_N.dtype)
    return Truth(
        r_TN_N=motion.r_TN_N,
        v_TN_N=motion.v_TN_N,
        r_ST_N=motion.r_ST_N,
        v_ST_N=motion.v_ST_N,
        q_BN=identity,
        omega_BN_B=zero,
        wheel_speed=zero,
        q_TN=identity,
        omega_TN_T=zero,
        mass=mass,
        delta_v=jnp.zeros_like(mass),
    )


def _node_table(places: np.ndarray) -> np.ndarray:
    """Matrix (nodes, samples) from samples at `places` in a step to values at the nodes with the same moments."""
    nodes = np.array(runge_kutta.NODES["rk8"])
    powers = np.arange(nodes.size)
    lagrange = np.linalg.inv(nodes[:, None] ** powers[None, :]).T
    weights = lagrange @ (1.0 / (powers + 1.0))
    return lagrange @ places[None, :] ** powers[:, None] / weights[:, None] / places.size
