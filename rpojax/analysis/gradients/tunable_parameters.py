"""The numbers of flight software that can be tuned, and the coordinates in which a gradient walks.

A positive number is walked in its logarithm, one between bounds in its logit, so that each step keeps to what is
allowed and counts alike for numbers of any size. Weights of the LQR matter by their ratios:
differences of logarithms.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.dispersions import dispersed_values
from rpojax.dispersions.dispersed_values import Values
from rpojax.errors import ScenarioError
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario.schema import ScenarioFile


@dataclass(frozen=True)
class LogCoordinate:
    """Positive numbers, by their logarithm: a step of 0.1 is about ten per cent."""

    def contains(self, value: np.ndarray) -> bool:
        """Whether all are positive."""
        return bool(np.all(value > 0.0))

    def to_coordinate(self, value: np.ndarray) -> np.ndarray:
        """Coordinate of a value."""
        return np.asarray(np.log(value))

    def from_coordinate(self, x: Array) -> Array:
        """Value at a coordinate."""
        return jnp.exp(x)


@dataclass(frozen=True)
class LogitCoordinate:
    """Numbers between two bounds, by the logit of their place."""

    low: float
    high: float

    def contains(self, value: np.ndarray) -> bool:
        """Whether all lie inside."""
        return bool(np.all((value > self.low) & (value < self.high)))

    def to_coordinate(self, value: np.ndarray) -> np.ndarray:
        """Coordinate of a value."""
        return np.asarray(np.log((value - self.low) / (self.high - value)))

    def from_coordinate(self, x: Array) -> Array:
        """Value at a coordinate."""
        return self.low + (self.high - self.low) * jax.nn.sigmoid(x)


Coordinate = LogCoordinate | LogitCoordinate


def _lead_time_coordinate(file: ScenarioFile) -> LogitCoordinate:
    """The middle of a burn, so that the look-away about it fits between two decisions."""
    half = 0.5 * file.pointing.look_away_limit_s
    return LogitCoordinate(half, file.rates.formation_period_s - half)


GROUPS: Final[dict[str, dict[str, Coordinate | Callable[[ScenarioFile], Coordinate]]]] = {
    "navigation": {
        "navigation.gps_noise_m": LogCoordinate(),
        "navigation.gps_error_sigma_m": LogCoordinate(),
        "navigation.gps_error_time_constant_s": LogCoordinate(),
        "navigation.edge_noise_px": LogCoordinate(),
        "navigation.center_sigma_m": LogCoordinate(),
        "navigation.center_time_constant_s": LogCoordinate(),
        "navigation.scale_sigma": LogCoordinate(),
        "navigation.scale_time_constant_s": LogCoordinate(),
        "navigation.bearing_bias_sigma_deg": LogCoordinate(),
        "navigation.attitude_sigma_deg": LogCoordinate(),
        "navigation.acceleration_noise_m_s2_sqrt_hz": LogCoordinate(),
        "navigation.relative_acceleration_noise_m_s2_sqrt_hz": LogCoordinate(),
        "navigation.burn_magnitude_sigma": LogCoordinate(),
        "navigation.burn_direction_sigma_deg": LogCoordinate(),
    },
    "gate": {"navigation.gate_sigma": LogitCoordinate(1.5, 12.0)},
    "formation": {
        "formation.position_weight": LogCoordinate(),
        "formation.velocity_weight": LogCoordinate(),
        "formation.delta_v_weight": LogCoordinate(),
    },
    "attitude": {
        "attitude_control.bandwidth_rad_s": LogitCoordinate(0.02, 2.0),
        "attitude_control.damping": LogitCoordinate(0.2, 3.0),
        "attitude_filter.star_tracker_noise_deg": LogCoordinate(),
        "attitude_filter.angle_random_walk_deg_sqrt_s": LogCoordinate(),
    },
    "schedule": {
        "formation.lead_s": _lead_time_coordinate,
        "formation.dead_band_mm_s": LogCoordinate(),
    },
}
"""Keys by the name under which they are tuned together, with their coordinates or what makes them of a scenario."""

NONSMOOTH: Final = ("gate", "formation", "schedule", "navigation.edge_noise_px", "navigation.scale_sigma")
"""Groups and keys whose numbers act through decisions: whether a box is believed, whether and when there is a burn.

What a box may be off by says which boxes pass the gate: of what these two do, derivatives see a third.
"""

TUNABLE: Final = {key: coordinate for group in GROUPS.values() for key, coordinate in group.items()}


@dataclass(frozen=True)
class TunableParameters:
    """Numbers to be tuned, each vector in one piece.

    Attributes:
        nominal: value to start from by key, in the user's units
        coordinates: in which each is walked, by key
        held: keys of the groups asked for that stay as they are, since no walk can start from them
    """

    nominal: dict[str, np.ndarray]
    coordinates: dict[str, Coordinate]
    held_fixed: tuple[str, ...]

    @property
    def count(self) -> int:
        """How many coordinates there are."""
        return sum(value.size for value in self.nominal.values())

    @property
    def names(self) -> list[str]:
        """Name of every coordinate: the key, or `key[0]`, `key[1]` for a vector."""
        return list(dispersion_keys.component_columns({key: value[None] for key, value in self.nominal.items()}))

    @property
    def initial(self) -> np.ndarray:
        """Coordinates (k,) to start from."""
        return np.concatenate(
            [self.coordinates[key].to_coordinate(value).ravel() for key, value in self.nominal.items()]
        )

    @property
    def nonsmooth(self) -> np.ndarray:
        """(k,) bool, whether the number acts through decisions."""
        deciding = {key for word in NONSMOOTH for key in GROUPS.get(word, (word,))}
        return np.concatenate([np.full(value.size, key in deciding) for key, value in self.nominal.items()])

    def values(self, x: Float[Array, " k"]) -> Values:
        """Values by key at coordinates (k,)."""
        found: Values = {}
        first = 0
        for key, nominal in self.nominal.items():
            part = x[first : first + nominal.size].reshape(nominal.shape)
            found[key] = self.coordinates[key].from_coordinate(part)
            first += nominal.size
        return found


def select_parameters(file: ScenarioFile, words: Sequence[str]) -> TunableParameters:
    """What to tune, from names of groups and keys.

    A key of a group from which no walk can start, such as a weight of zero, is held; one that is asked for by its own
    name is refused.

    Raises:
        ScenarioError: a word is neither a group nor a key that can be tuned, the key is dispersed, or nothing is left.
    """
    asked: list[tuple[str, bool]] = []
    for word in words:
        if word in GROUPS:
            asked += [(key, False) for key in GROUPS[word]]
        elif word in TUNABLE:
            asked.append((word, True))
        else:
            raise ScenarioError("--parameters", word, f"one of {', '.join(GROUPS)}, or a key of theirs")
    nominal, coordinates, held = {}, {}, []
    for key, by_name in dict(asked).items():
        value = np.asarray(schema.nominal_value(file, key), dtype=np.float64)
        if key in dispersion_keys.varied_keys(file):
            raise ScenarioError(key, "a dispersion of it", "a number that all runs share, to tune it")
        coordinate = _coordinate(file, key)
        if coordinate.contains(value):
            nominal[key], coordinates[key] = value, coordinate
        elif by_name:
            raise ScenarioError(key, value.tolist(), _expected(coordinate))
        else:
            held.append(key)
    if not nominal:
        raise ScenarioError("--parameters", ",".join(words), "at least one number that can be tuned")
    return TunableParameters(nominal, coordinates, tuple(held))


def run_values(file: ScenarioFile, tunable: TunableParameters, x: Array, run_key: Array) -> Values:
    """Values of a run: its dispersions as drawn, and the tuned numbers at coordinates (k,)."""
    return {**dispersed_values.draw(file, run_key, {}), **tunable.values(x)}


def _coordinate(file: ScenarioFile, key: str) -> Coordinate:
    entry = TUNABLE[key]
    return entry if isinstance(entry, LogCoordinate | LogitCoordinate) else entry(file)


def _expected(coordinate: Coordinate) -> str:
    if isinstance(coordinate, LogitCoordinate):
        return f"a start between {coordinate.low:g} and {coordinate.high:g}"
    return "a positive start: the walk is one in its logarithm"
