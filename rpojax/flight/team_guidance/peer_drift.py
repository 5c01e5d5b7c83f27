"""Free drifts of a servicer relative to the others: those that a burn must not lead near to.

Target and servicers are so near to each other that the difference of two motions about the target's orbit follows the
same linear equations; so another servicer takes the target's place in the clearance of a drift. A burn that it has
announced counts as made.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.mission import drift_clearance
from rpojax.flight.mission.drift_clearance import Drift
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.team_knowledge import KnownPeers

Scalar = Float[Array, ""]


@pytree
class NextBurn:
    """Place and time of the middle of a servicer's next burn.

    Attributes:
        orbit: of the target there
        R_CN: (3, 3) Hill frame there
        time: () now [s]
        lead: () from now to the burn [s]
    """

    orbit: TargetOrbit
    R_CN: Array
    time: Array
    lead: Array


@pytree
class PeerDrifts:
    """Free drifts of a servicer relative to others from the middle of its next burn on.

    Attributes:
        state_H: (peers, 6) of this servicer from each, before the burn [m, m/s]
        covariance_H: (peers, 6, 6)
        orbit: of the target at the burn
        sigmas: () of the covariance that are covered [-]
        radius: () that the drift must stay clear of [m]
        first_span: () free motion that is sampled [s]
        horizon: () end of the drift, at least the span [s]
    """

    state_H: Array
    covariance_H: Array
    orbit: TargetOrbit
    sigmas: Array
    radius: Array
    first_span: Array
    horizon: Array


def relative_motion(
    estimate: OrbitEstimate, peers: KnownPeers, burn: NextBurn, announced_sigma: Scalar
) -> tuple[Float[Array, "peers 6"], Float[Array, "peers 6 6"]]:
    """States of this servicer from each of its peers at its next burn, and their covariances.

    `estimate` is that of both orbits now; announced burns have a 1-sigma error per axis over their size [-].
    """
    relative, servicer = estimate.relative, estimate.servicer
    r_TN_N, v_TN_N = servicer.r_SN_N + relative.r_TS_N, servicer.v_SN_N + relative.v_TS_N
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)
    orbit = yamanaka_ankersen.target_orbit(r_TN_N, v_TN_N)
    columns = [
        jnp.concatenate(inertial_to_hill(unit[:3], unit[3:], R_HN, omega_HN_N))
        for unit in jnp.eye(6, dtype=r_TN_N.dtype)
    ]
    to_hill = jnp.stack(columns, axis=1)
    transition = yamanaka_ankersen.free_motion(
        burn.orbit, burn.lead, yamanaka_ankersen.constants_of_motion(orbit, to_hill)
    )

    def of_peer(_: None, peer: tuple[Array, Array, Intent]) -> tuple[None, tuple[Array, Array]]:
        state_N, covariance_N, plans = peer
        state_H = -jnp.sum(transition * state_N[None], axis=1)
        state_H = state_H - _effect(orbit, burn, plans)
        half = jnp.sum(transition[:, :, None] * covariance_N[None], axis=1)
        covariance_H = jnp.sum(half[:, None] * transition[None], axis=2)
        execution = announced_sigma**2 * jnp.sum(plans.delta_v_N**2, axis=0)
        return None, (state_H, covariance_H + jnp.diag(jnp.concatenate([jnp.zeros(3), jnp.full(3, execution)])))

    _, motion = jax.lax.scan(of_peer, None, (peers.state_N, peers.covariance_N, peers.intents))
    return motion


def _effect(orbit: TargetOrbit, burn: NextBurn, plans: Intent) -> Float[Array, "6"]:
    """Effect [m, m/s] of an announced burn on the peer's state at the own one, before or after which it is made."""
    after = plans.burn_time - burn.time
    place = yamanaka_ankersen.advanced(orbit, after)
    c, s = cos_sin(place.argument_of_latitude - burn.orbit.argument_of_latitude)
    x, y, z = apply(burn.R_CN, plans.delta_v_N)
    change = jnp.stack([0.0 * x, 0.0 * x, 0.0 * x, c * x + s * y, c * y - s * x, z])
    constants = yamanaka_ankersen.constants_of_motion(place, change)
    return yamanaka_ankersen.free_motion(burn.orbit, burn.lead - after, constants)


def least_clearance(
    drifts: PeerDrifts, directions_H: Float[Array, "3 d"], sizes: Float[Array, "d k"]
) -> tuple[Float[Array, "peers d k"], Float[Array, "peers d k"]]:
    """Least distance from each peer over that which is kept, of each burn: uncertain, and by the estimate alone.

    Args:
        drifts: relative to the peers
        directions_H: (3, d) directions of burns, of any length
        sizes: (d, k) factors on each direction [m/s]
    """

    def of_peer(_: None, peer: tuple[Array, Array]) -> tuple[None, tuple[Array, Array]]:
        drift = Drift(
            orbit=drifts.orbit,
            state_H=peer[0],
            scale_sigma=jnp.zeros_like(drifts.horizon),
            covariance_H=peer[1],
            sigmas=drifts.sigmas,
            semi_axes=jnp.stack([drifts.radius] * 3),
            first_span=drifts.first_span,
            horizon=drifts.horizon,
        )
        return None, drift_clearance.least_clearance(drift, directions_H, sizes)

    _, clearances = jax.lax.scan(of_peer, None, (drifts.state_H, drifts.covariance_H))
    return clearances
