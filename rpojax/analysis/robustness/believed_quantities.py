"""Quantities of the truth of which flight software believes a value and a sigma."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.scenario.numbers.start_and_limits import HANDOVER_KEYS
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import HandoverSection
from rpojax.scenario.warnings.key_uses import Situation, unused_keys

Values = Mapping[str, np.ndarray]
HANDOVER: Final = "initial.handover"
_GOLDEN_ANGLE: Final = math.pi * (3.0 - math.sqrt(5.0))
"""Angle [rad] by whose multiples directions are spread evenly for any number of runs."""
_LEAST: Final = 0.01
"""Fraction of its nominal value below which a quantity that cannot be zero is not moved."""


@dataclass(frozen=True)
class Quantity:
    """A quantity, and how it is moved away from its nominal value.

    Attributes:
        name: its key, or the section of its keys
        title: for readers
        unit: of values and of margins
        nominal: value that the scenario has; of an angle across an axis its size
        believed_sigma: in the unit
        belief: where that comes from
        keys: that are moved
        least: least value that means something; None without one
        across: two unit vectors across which the keys are turned, by another direction in each run; None for numbers
        is_factor: whether the quantity is a factor on the keys
    """

    name: str
    title: str
    unit: str
    nominal: float
    believed_sigma: float
    belief: str
    keys: tuple[str, ...]
    least: float | None = None
    across: np.ndarray | None = None
    is_factor: bool = False

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides to which it can be moved; a turn has `any` direction."""
        return ("low", "high") if self.across is None else ("any",)

    def farthest(self, side: str) -> float:
        """Size of the last step to a side [sigmas]."""
        if side != "low" or self.least is None:
            return math.inf
        return (self.nominal - self.least) / self.believed_sigma

    def offset(self, side: str, size: float) -> float:
        """Offset of a step to a side, in the unit, from its size in sigmas."""
        return (-size if side == "low" else size) * self.believed_sigma

    def moved(self, values: Values, offset: float, run_ids: np.ndarray) -> dict[str, np.ndarray]:
        """Values (runs, ...) of the keys at an offset, from those of runs with numbers `run_ids` (runs,)."""
        if self.is_factor:
            return {key: values[key] * (1.0 + offset) for key in self.keys}
        (key,) = self.keys
        if self.across is not None:
            turns = _GOLDEN_ANGLE * run_ids
            return {key: values[key] + offset * np.stack([np.cos(turns), np.sin(turns)], axis=1) @ self.across}
        found = values[key] + offset
        return {key: found if self.least is None else np.maximum(found, self.least)}


def with_handover(file: ScenarioFile) -> ScenarioFile:
    """The scenario with the hand-over errors of which the filter is told also as the true ones.

    A scenario that gives the true ones as a covariance is returned as it is.
    """
    given = file.initial.handover.model_dump() if file.initial.handover is not None else {}
    if "covariance" in given:
        return file
    told = {key: getattr(file.navigation, f"initial_{key}") for key in HANDOVER_KEYS}
    initial = file.initial.model_copy(update={"handover": HandoverSection(**{**told, **given})})
    return file.model_copy(update={"initial": initial})


def find_quantities(file: ScenarioFile) -> tuple[list[Quantity], dict[str, str]]:
    """Quantities that a scenario has and uses and of which its filter believes a sigma; reasons for the others."""
    unused = unused_keys(Situation(file, is_of_team=False))
    found, left_out = [], {}
    for each in _candidates(file):
        needs = next((unused[key] for key in each.keys if key in unused), None)
        if needs is not None:
            left_out[each.name] = f"has no effect without {needs}"
        elif not each.believed_sigma > 0.0:
            left_out[each.name] = f"the filter believes no error of it ({each.belief} = 0)"
        else:
            found.append(each)
    handover = file.initial.handover
    if handover is not None and handover.covariance is not None:
        left_out[HANDOVER] = "given as a covariance"
    return found, left_out


def _candidates(file: ScenarioFile) -> Iterator[Quantity]:
    believed, thruster = file.navigation, file.thruster
    thrust, thrust_key = _first_positive(believed, "burn_scale_sigma", "burn_magnitude_sigma")
    direction, direction_key = _first_positive(believed, "thrust_direction_sigma_deg", "burn_direction_sigma_deg")
    yield _number(file, "thruster.force_scale", "thrust over the nominal one", "-", thrust, thrust_key)
    yield _turn(
        file, "thruster.misalignment_deg", "thrust direction", direction, direction_key, _across(thruster.direction)
    )
    yield _turn(
        file,
        "camera.misalignment_deg",
        "camera mounting",
        believed.bearing_bias_sigma_deg,
        "navigation.bearing_bias_sigma_deg",
        np.eye(3)[:2],
    )
    size = (believed.target_size_sigma, "navigation.target_size_sigma")
    if size[0] <= 0.0:
        size = (believed.scale_sigma[0], "navigation.scale_sigma[0]")
    yield _number(file, "target.scale", "target size over the nominal one", "-", *size)
    of_boxes, of_gps = (believed.edge_noise_px, "navigation.edge_noise_px"), (believed.gps_noise_m, "gps_noise_m")
    yield _number(file, "camera.edge_noise_px", "noise of box edges", "px", *of_boxes, least=0.0)
    yield _number(file, "gps.noise_m", "GPS noise", "m", of_gps[0], f"navigation.{of_gps[1]}", least=0.0)
    ballistic = believed.ballistic_sigma_m2_kg * file.target.mass_kg
    area_key = "navigation.ballistic_sigma_m2_kg times target.mass_kg"
    yield _number(file, "target_surface.area_m2", "area of the target in air and sunlight", "m2", ballistic, area_key)
    mass = thrust * file.servicer.mass_kg
    yield _number(file, "servicer.mass_kg", "mass of the servicer", "kg", mass, f"{thrust_key} times the mass")
    if file.initial.handover is None or file.initial.handover.covariance is None:
        keys = tuple(f"{HANDOVER}.{key}" for key in HANDOVER_KEYS)
        title, belief = "hand-over errors over those told", "the errors that the filter is told"
        yield Quantity(HANDOVER, title, "-", 1.0, 1.0, belief, keys, least=0.0, is_factor=True)


def _first_positive(section: Any, *names: str) -> tuple[float, str]:
    """The first of some beliefs that is not zero, and its key; the first one if all are."""
    chosen = next((name for name in names if getattr(section, name) > 0.0), names[0])
    return getattr(section, chosen), f"navigation.{chosen}"


def _number(
    file: ScenarioFile, key: str, title: str, unit: str, sigma: float, belief: str, least: float | None = None
) -> Quantity:
    nominal = float(nominal_of_key(file, key))
    return Quantity(key, title, unit, nominal, sigma, belief, (key,), _LEAST * nominal if least is None else least)


def _turn(file: ScenarioFile, key: str, title: str, sigma: float, belief: str, across: np.ndarray) -> Quantity:
    nominal = float(np.linalg.norm(across @ np.asarray(nominal_of_key(file, key))))
    return Quantity(key, title, "deg", nominal, sigma, belief, (key,), across=across)


def _across(axis: Any) -> np.ndarray:
    """Two unit vectors (2, 3) across an axis (3,)."""
    return np.linalg.svd(np.asarray(axis, dtype=np.float64)[None])[2][1:]
