"""Tunable numbers of the flight software by group, and their coordinates.

A positive number is tuned in its logarithm, one between bounds in its logit, so that every step stays in range and is
relative. Weights of the LQR matter by their ratios: differences of logarithms.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.checks.validation_errors import did_you_mean
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import component_columns, nominal_of_key
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.key_uses import Situation, unused_keys
from rpojax.sensors.additional.registry import present_sensors

_WEIGHTS: Final = ("formation.position_weight", "formation.velocity_weight", "formation.delta_v_weight")
NONSMOOTH: Final = ("gate", "formation", "schedule", "navigation.edge_noise_px", "navigation.scale_sigma")
"""Groups and keys that act through decisions: whether a box is accepted, whether and when there is a burn.

The noise and scale of a box decide which boxes pass the gate: derivatives see a third of the effect of these two.
"""
_DEFAULT_S = 2000.0
"""Simulated time of a run of a mission of one phase, such as station keeping [s]."""


@dataclass(frozen=True)
class LogCoordinate:
    """Logarithm of positive numbers: a step of 0.1 is about ten per cent."""

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
    """Logit of numbers between two bounds."""

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
    """Bounds of the middle of a burn, so that the look-away about it fits between two decisions."""
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
        "navigation.burn_scale_sigma": LogCoordinate(),
        "navigation.burn_direction_sigma_deg": LogCoordinate(),
    },
    "pose": {
        "navigation.tumble_sigma_deg_s": LogCoordinate(),
        "navigation.tumble_walk_deg_s_sqrt_s": LogCoordinate(),
        "navigation.inertia_ratio_sigma": LogCoordinate(),
        "navigation.body_offset_sigma_m": LogCoordinate(),
    },
    "gate": {"navigation.gate_sigma": LogitCoordinate(1.5, 12.0)},
    "formation": dict.fromkeys(_WEIGHTS, LogCoordinate()),
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
"""Keys by group, with their coordinates or functions that make them from a scenario."""


TUNABLE: Final = {key: coordinate for group in GROUPS.values() for key, coordinate in group.items()}


@dataclass(frozen=True)
class TunableParameters:
    """Selected numbers to tune.

    Attributes:
        nominal: initial value by key, in the user's units
        coordinates: of each, by key
        held_fixed: keys of the selected groups that cannot be tuned from their value, or have no effect
    """

    nominal: dict[str, np.ndarray]
    coordinates: dict[str, Coordinate]
    held_fixed: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return sum(value.size for value in self.nominal.values())

    @property
    def names(self) -> list[str]:
        """Name of every coordinate: the key, or `key[0]`, `key[1]` for a vector."""
        return list(component_columns({key: value[None] for key, value in self.nominal.items()}))

    @property
    def initial(self) -> np.ndarray:
        """Initial coordinates (k,)."""
        return np.concatenate(
            [self.coordinates[key].to_coordinate(value).ravel() for key, value in self.nominal.items()]
        )

    @property
    def nonsmooth(self) -> np.ndarray:
        """(k,) bool, whether the number acts through decisions."""
        nonsmooth = {key for name in NONSMOOTH for key in GROUPS.get(name, (name,))}
        return np.concatenate([np.full(value.size, key in nonsmooth) for key, value in self.nominal.items()])

    def values(self, x: Float[Array, " k"]) -> Values:
        """Values by key at coordinates (k,)."""
        found: Values = {}
        first = 0
        for key, nominal in self.nominal.items():
            part = x[first : first + nominal.size].reshape(nominal.shape)
            found[key] = self.coordinates[key].from_coordinate(part)
            first += nominal.size
        return found


def select_parameters(file: ScenarioFile, names: Sequence[str], replaced: Collection[str] = ()) -> TunableParameters:
    """Numbers to tune, from names of groups and keys.

    A key of a group that cannot be tuned from its value, such as a weight of zero, or that has no effect in the
    scenario, is held fixed; one that is named itself is refused. Stages are `replaced` beside those of the plugin.

    Raises:
        ScenarioError: a name is neither a group nor a tunable key, the key is dispersed or without effect, or nothing
            is left.
    """
    stages = plugin_registry.replaced_stages(file, replaced)
    unused = unused_keys(Situation(file, is_of_team=bool(file.servicers), replaced=stages))
    beliefs = _beliefs(file)
    selected: dict[str, bool] = {}
    for name in names:
        if name in GROUPS:
            selected |= dict.fromkeys(GROUPS[name], False)
        elif name in TUNABLE or name in beliefs:
            selected[name] = True
        else:
            near = did_you_mean(name, [*GROUPS, *TUNABLE, *beliefs])
            expected = f"one of {', '.join(GROUPS)}, or a key of theirs{near}"
            raise ScenarioError("parameters", name, expected, is_argument=True)
    nominal, coordinates, held = {}, {}, []
    for key, by_name in selected.items():
        value = np.asarray(nominal_of_key(file, key), dtype=np.float64)
        weight = key.removeprefix("formation.")
        if key in _WEIGHTS and file.phases and all(getattr(phase, weight) is not None for phase in file.phases):
            raise ScenarioError(key, "phases, which have weights of their own", "no [[phases]] to tune it")
        if key in dispersion_keys.varied_keys(file):
            raise ScenarioError(key, "a dispersion of it", "a number that all runs share, to tune it")
        coordinate = _coordinate(file, key)
        if key in unused and by_name:
            raise ScenarioError(key, value.tolist(), f"{unused[key]} beside it, without which it has no effect")
        if key not in unused and coordinate.contains(value):
            nominal[key], coordinates[key] = value, coordinate
        elif by_name:
            raise ScenarioError(key, value.tolist(), _expected(coordinate))
        else:
            held.append(key)
    if not nominal:
        raise ScenarioError("parameters", ",".join(names), "at least one number that can be tuned", is_argument=True)
    return TunableParameters(nominal, coordinates, tuple(held))


def run_values(file: ScenarioFile, tunable: TunableParameters, x: Array, run_key: Array) -> Values:
    """Values of a run by key: its drawn dispersions, and the tuned numbers at coordinates (k,)."""
    return {**dispersed_values.draw(file, run_key, {}), **tunable.values(x)}


def _beliefs(file: ScenarioFile) -> list[str]:
    """Keys of the parameters that flight software assumes of the additional sensors in use."""
    present = present_sensors(file).items()
    return [f"{name}.{key}" for name, sensor in present if sensor.is_believed() for key in sensor.beliefs]


def _coordinate(file: ScenarioFile, key: str) -> Coordinate:
    """Coordinate of a number; a belief about an additional sensor is positive."""
    entry = TUNABLE.get(key, LogCoordinate())
    return entry if isinstance(entry, LogCoordinate | LogitCoordinate) else entry(file)


def _expected(coordinate: Coordinate) -> str:
    if isinstance(coordinate, LogitCoordinate):
        return f"a start between {coordinate.low:g} and {coordinate.high:g}"
    return "a positive start: it is tuned in its logarithm"


def scenario_at_horizon(file: ScenarioFile, settings: TuningSettings) -> ScenarioFile:
    """The scenario with the duration of the tuning's runs.

    Raises:
        ScenarioError: the scenario cannot be tuned by gradient.
        RpojaxError: it does not suit the time of the tuning's runs, or its phases do not fit into it.
    """
    check_differentiable(file)
    if file.design.kind != "independent":
        raise ScenarioError("design.kind", file.design.kind, "'independent', since every step draws fresh runs")
    used = horizon(file, settings)
    try:
        return scenario_loader.with_duration(file, used)
    except ScenarioError as error:
        if used == file.duration_s:
            raise
        expected = f"a time that suits the scenario of {file.duration_s:g} s"
        if file.phases:
            expected = f"one in which the phases of the mission of {file.duration_s:g} s can end"
        raise RpojaxError.of_argument("horizon_s", f"found {used:g} ({error}), expected {expected}") from None


def horizon(file: ScenarioFile, settings: TuningSettings) -> float:
    """Simulated time of a run of the tuning [s], at most that of the scenario.

    By default it is 2000 s, and all of a mission of several phases: those that have not begun are not tuned for.
    """
    default = file.duration_s if len(file.phases) > 1 else _DEFAULT_S
    return min(default if settings.horizon_s is None else settings.horizon_s, file.duration_s)


def unreached_phases_warning(file: ScenarioFile, settings: TuningSettings) -> str | None:
    """Why runs of a tuning may not get to all phases of a mission; None if they are as long as the mission."""
    used = horizon(file, settings)
    if len(file.phases) < 2 or used >= file.duration_s:
        return None
    return f"horizon: {used:g} s of a mission of {file.duration_s:g} s: phases that begin later are not tuned for"


_DIFFERENTIABLE: Final = "'geometric' or 'statistical', or a temperature of `rpojax.gradient` for a soft detector"


def check_differentiable(file: ScenarioFile) -> None:
    """Refuses the rendered camera, whose detector decides: that has no useful gradient.

    Raises:
        ScenarioError: the scenario has one.
    """
    if file.camera.model == "rendered":
        raise ScenarioError("camera.model", "rendered", _DIFFERENTIABLE)
