"""Pictures of a target that looks alike in several attitudes: their landmarks as those of the attitude that is held.

Of a body without symmetries all is left as it is.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply, product
from rpojax.flight.navigation import landmark_measurement, relative_filter_state, symmetric_attitudes
from rpojax.flight.navigation.landmark_measurement import LandmarkView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget, attitude, cross_matrix

_TURNED = ("attitude", "rate", "body_offset")
"""Slow states that are vectors in T."""


def as_held(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> LandmarkView:
    """Picture whose landmarks have the names that they have in the attitude that is held, by where they are."""
    if target.symmetries is None:
        return view
    best = jnp.argmin(mismatches(tuning, target, estimate, view), axis=0)
    return _renamed(view, target.symmetries.permutations[best])


def mismatches(
    tuning: OrbitFilterTuning, target: BelievedTarget, estimate: RelativeEstimate, view: LandmarkView
) -> Float[Array, " s"]:
    """Sum of the squared residuals of landmarks in sigmas, each at most that of the gate, by each symmetry.

    By the symmetry `t` the picture is one of the attitude `turns[t] q_TN`.
    """
    assert target.symmetries is not None
    expected, spread = landmark_measurement.expected(target, estimate, view)

    def of_one(order: Int[Array, " n"]) -> Array:
        named = _renamed(view, order)
        noise = named.variance + named.attitude_variance
        square, determinant = jax.vmap(landmark_measurement.squared_residual)(spread, noise, named.tangents - expected)
        squares = square / determinant
        return jnp.sum(jnp.where(named.present, jnp.minimum(squares, tuning.gate_sigma**2), 0.0), axis=0)

    return jax.vmap(of_one)(target.symmetries.permutations)


def _renamed(view: LandmarkView, order: Int[Array, " n"]) -> LandmarkView:
    """Picture in which each landmark is where another was found, by its number."""
    return replace(view, tangents=view.tangents[order], variance=view.variance[order], present=view.present[order])


def weighed(
    tuning: OrbitFilterTuning,
    target: BelievedTarget,
    estimate: RelativeEstimate,
    view: LandmarkView,
    used: Bool[Array, ""],
) -> RelativeEstimate:
    """Estimate with the vote of a picture that was `used`, in the attitude that the votes are for."""
    reference = estimate.target
    if target.symmetries is None or reference is None or reference.votes is None:
        return estimate
    costs = mismatches(tuning, target, estimate, view)
    votes = symmetric_attitudes.voted(reference.votes, jax.nn.softmax(-0.5 * costs, axis=0), used & reference.known)
    best, switches = symmetric_attitudes.better(votes)
    switches = switches & reference.known
    estimate = replace(estimate, target=replace(reference, votes=votes))

    def switched(estimate: RelativeEstimate) -> RelativeEstimate:
        return _turned(tuning, target, estimate, jnp.where(switches, best, 0), switches)

    return jax.lax.cond(any_of_batch(switches), switched, lambda estimate: estimate, estimate)


def _turned(
    tuning: OrbitFilterTuning,
    target: BelievedTarget,
    estimate: RelativeEstimate,
    number: Int[Array, ""],
    turns: Bool[Array, ""],
) -> RelativeEstimate:
    """Estimate with the attitude `turns[number] q_TN`, if it `turns`: all landmarks stay where they are.

    Moments of inertia that the body was found to have are those of other axes now, and become as uncertain as before.
    """
    symmetries, reference, layout = target.symmetries, estimate.target, estimate.layout
    assert symmetries is not None and reference is not None and reference.votes is not None
    turn = quaternion.to_matrix(symmetries.turns[number])
    before = attitude(reference, estimate.slow)
    # A turn about an axis beside the centre of mass has another place of the body as that centre.
    shift_T = apply(turn.T, symmetries.shifts[number])
    R_NT = quaternion.to_matrix(quaternion.conjugate(before))
    mapping = jnp.eye(layout.size, dtype=turn.dtype)
    mapping = mapping.at[layout["position"], layout["attitude"]].set(-product(R_NT, cross_matrix(shift_T)))
    for name in _TURNED:
        mapping = mapping.at[layout[name], layout[name]].set(turn)
    moved = replace(
        estimate,
        r_TS_N=estimate.r_TS_N - apply(R_NT, shift_T),
        slow=estimate.slow | {name: apply(turn, estimate.slow[name]) for name in _TURNED},
        covariance=product(product(mapping, estimate.covariance), mapping.T),
        target=replace(
            reference,
            q_TN=quaternion.multiply(symmetries.turns[number], reference.q_TN),
            votes=symmetric_attitudes.seen_from(symmetries, reference.votes, number),
        ),
    )
    moved = jax.tree.map(lambda after, before: jnp.where(turns, after, before), moved, estimate)
    return relative_filter_state.reset_to_prior(tuning, moved, ("inertia_ratio",), turns)
