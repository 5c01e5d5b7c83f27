"""Impulses of transfers before flight, and times between impulses that no free motion or few of them fill."""

import functools
import math
from dataclasses import dataclass
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.orbits.two_impulse_transfer import state_on_arc
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, transition_matrix
from rpojax.flight.guidance.references import transfer as transfers
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.scenario.numbers.section_records import section_record
from rpojax.scenario.phases.reference_sections import TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.nominal_motion import at_latitudes, latitudes_after, mean_motion, orbit_from

_REGULAR: Final = 0.4
"""Least singular value of a regular time [-]."""
_POINTS: Final = 361
"""Points of the way of a transfer at which it is looked at [-]."""
_NEARLY_CIRCULAR: Final = 0.01
"""Eccentricity up to which every place on the orbit is like any other [-]."""
_PLACES: Final = 24
"""Places on an elliptic orbit at which a phase may begin, at equal intervals of time [-]."""
_DURATION_STEP: Final = 0.005
"""Step of the search for regular durations, in periods [-]."""
_NO_IMPULSE: Final = 1e-9
"""Size of an impulse on the way that is rounding alone [m/s]."""


@dataclass(frozen=True)
class TransferImpulses:
    """Transfer as it is flown from rest to rest.

    Attributes:
        way: (n, 3) positions along it [m]
        points: (k, 3) positions of its impulses [m]
        impulses: (k, 3) velocity changes [m/s]
    """

    way: np.ndarray
    points: np.ndarray
    impulses: np.ndarray


def transfer_impulses(file: ScenarioFile, transfer: TransferSection, start: np.ndarray) -> TransferImpulses:
    """Transfer from a `start` [m]; on an elliptic orbit that whose largest impulse is the median over places on it."""
    flown = [_at_place(*each) for each in zip(*_flown_from(file, transfer, start, _places(file)), strict=True)]
    by_size = sorted(flown, key=lambda each: float(np.max(np.linalg.norm(each.impulses, axis=1))))
    return by_size[len(by_size) // 2]


def share_of_singular_places(file: ScenarioFile, seconds: float) -> float:
    """Share of the orbit, by time, from which one impulse hardly moves the servicer along some direction in a time."""
    return float(np.mean(_least_effects(file, seconds)[0] < _REGULAR))


def sensitivity(file: ScenarioFile, seconds: float) -> float:
    """Change of two impulses [m/s] for each metre of the position: the median over places on the orbit."""
    effects, scales = _least_effects(file, seconds)
    return float(np.median(scales / np.maximum(effects, 1e-9)))


def nearest_regular(file: ScenarioFile, seconds: float) -> tuple[float | None, float | None]:
    """The nearest shorter and longer time [s] that is regular at most places; None where none is within an orbit."""
    step = _DURATION_STEP * 2.0 * math.pi / mean_motion(file)
    steps = range(1, round(1.0 / _DURATION_STEP) + 1)
    found = [
        next((time for time in times if time > 0.0 and share_of_singular_places(file, time) <= 0.5), None)
        for times in ((seconds + sign * count * step for count in steps) for sign in (-1.0, 1.0))
    ]
    return found[0], found[1]


def _places(file: ScenarioFile) -> np.ndarray:
    """Arguments of latitude (p,) [rad] at which a phase may begin, as far as they differ."""
    start = math.radians(file.orbit.argument_of_perigee_deg + file.orbit.true_anomaly_deg)
    if file.orbit.eccentricity <= _NEARLY_CIRCULAR:
        return np.array([start])
    return latitudes_after(file, start, 2.0 * math.pi / mean_motion(file) * np.arange(_PLACES) / _PLACES)


def _least_effects(file: ScenarioFile, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Effect (p,) [-] of an impulse on the position after a time in the least direction, by place, and its scale [1/s].

    The scale is the inverse of the time or, after more than a radian, of the time per radian.
    """
    found, angles = _motions_after(orbit_from(file, 0.0), _places(file), seconds)
    motions, scales = np.asarray(found), np.hypot(1.0, np.asarray(angles)) / seconds
    in_plane = motions[:, :2, 3:5] * scales[:, None, None]
    # The determinant is the product of the singular values: over the norm, the smaller one where the other is large.
    least = np.abs(np.linalg.det(in_plane)) / np.linalg.norm(in_plane, axis=(1, 2))
    return np.minimum(least, np.abs(motions[:, 2, 5]) * scales), scales


@jax.jit
def _motions_after(
    orbit: TargetOrbit, latitudes: Float[Array, " p"], seconds: Float[Array, ""]
) -> tuple[Float[Array, "p 6 6"], Float[Array, " p"]]:
    """Transition matrices over a time [s] from places on an orbit, and the angles [rad] by which the target moves."""

    def motion(place: TargetOrbit) -> tuple[Array, Array]:
        moved = advanced(place, seconds).argument_of_latitude - place.argument_of_latitude
        return transition_matrix(place, seconds), moved

    return jax.vmap(motion)(at_latitudes(orbit, latitudes))


def _flown_from(
    file: ScenarioFile, transfer: TransferSection, start: np.ndarray, latitudes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transfers from rest at places (p,) on the orbit: states, place and size of the impulse on the way, by arc."""
    reference = section_record(transfers.Transfer, transfer.model_dump())
    at_rest = jnp.concatenate([jnp.asarray(start, dtype=jnp.float64), jnp.zeros(3)])
    states, points, impulses = _arcs(reference, at_rest, orbit_from(file, 0.0), latitudes, transfer.pulses - 1)
    return np.asarray(states), np.asarray(points), np.asarray(impulses)


@functools.partial(jax.jit, static_argnames="count")
def _arcs(
    reference: transfers.Transfer,
    at_rest: Float[Array, "6"],
    orbit: TargetOrbit,
    latitudes: Float[Array, " p"],
    count: int,
) -> tuple[Float[Array, "p arcs n 6"], Float[Array, "p arcs 3"], Float[Array, "p arcs 3"]]:
    """States [m, m/s] at equal times on each arc, and the place [m] and size [m/s] of the impulse on the way."""
    shares = jnp.linspace(0.0, 1.0, max(2, _POINTS // count))

    def arc(place: TargetOrbit, number: Array) -> tuple[Array, Array, Array]:
        way, departure, _ = transfers.arc_between_impulses(
            reference, PhaseEntry(relative_state=at_rest, orbit=place), number
        )
        times = jnp.append(shares * reference.duration / count, way.impulse_after)
        states = jax.vmap(lambda since: state_on_arc(way, departure, since))(times)
        return states[:-1], states[-1, :3], way.delta_v

    of_place = jax.vmap(arc, in_axes=(None, 0))
    numbers = jnp.arange(count, dtype=jnp.float64)
    return jax.vmap(lambda place: of_place(place, numbers))(at_latitudes(orbit, latitudes))


def _at_place(states: np.ndarray, middles: np.ndarray, on_the_way: np.ndarray) -> TransferImpulses:
    """Transfer from one place, from its states (arcs, n, 6) and the impulses (arcs, 3) on the way at points."""
    rest = np.zeros((1, 3))
    of_ends = np.concatenate([states[:, 0, 3:], rest]) - np.concatenate([rest, states[:, -1, 3:]])
    ends = np.concatenate([states[:, 0, :3], states[-1:, -1, :3]])
    order = np.argsort(np.r_[np.arange(len(ends)), np.arange(len(middles)) + 0.5])
    points, impulses = np.concatenate([ends, middles])[order], np.concatenate([of_ends, on_the_way])[order]
    made = np.ones(len(order), dtype=bool)
    made[1::2] = np.linalg.norm(on_the_way, axis=1) > _NO_IMPULSE
    return TransferImpulses(states[..., :3].reshape(-1, 3), points[made], impulses[made])
