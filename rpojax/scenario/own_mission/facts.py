"""What one knows of a mission before there is a scenario of it, and the checks of that."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from rpojax.errors import RpojaxError


def fact(question: str, default: Any, low: float = 0.0, high: float = math.inf) -> Any:
    """Field of `MissionFacts`: what is asked for, what is taken unless it is said, and the limits of its numbers."""
    return dataclasses.field(default=default, metadata={"question": question, "low": low, "high": high})


@dataclass(frozen=True, kw_only=True)
class MissionFacts:
    """What one knows of a mission. None leaves a number to the others."""

    mass_kg: float = fact("mass of the servicer [kg]", 30.0, 0.5, 1e5)
    thrust_n: float = fact("thrust of the servicer [N]", 0.03, 1e-5, 1e4)
    target_m: tuple[float, ...] = fact(
        "body of the target: one side, or three, apart by blanks [m]", (0.5, 0.5, 0.6), 0.01, 100.0
    )
    span_m: float | None = fact("target across its panels, none without [m]", None, 0.01, 200.0)
    target_mesh: str | None = fact("mesh of the target in place of its sizes", None)
    mesh_units: str | None = fact("length of a unit of the mesh", None)
    target_mass_kg: float | None = fact("mass of the target [kg]", None, 0.01, 1e6)
    tumble_deg_s: float = fact("rate of the target's tumble [deg/s]", 1.0, 0.0, 30.0)
    size_sigma: float = fact("what the size of the target is known to, as a share of it", 0.0, 0.0, 0.25)
    altitude_km: float = fact("altitude [km]", 500.0, 200.0, 60000.0)
    inclination_deg: float | None = fact("inclination, unless the Sun says it [deg]", None, 0.0, 180.0)
    local_time_h: float | None = fact("local time of the ascending node [h]", None, 0.0, 24.0)
    beta_deg: float | None = fact("angle of the Sun out of the orbit plane [deg]", None, -90.0, 90.0)
    hold_m: float = fact("distance at which the servicer holds, behind the target [m]", 30.0, 0.1, 2000.0)
    approach_m: float | None = fact("distance to which it then approaches, none without [m]", None, 0.1, 2000.0)
    start_m: float | None = fact("distance at the start [m]", None, 0.1, 5000.0)
    lens_deg: float | None = fact("field of view of the camera [deg]", None, 0.1, 150.0)
    pixels: int | None = fact("pixels along a side of the picture", None, 16, 4096)

    full_environment: bool = fact("drag, pressure of sunlight, wheel friction and all other effects", False)

    def __post_init__(self) -> None:
        """Checks each fact, and those that must suit each other.

        Raises:
            RpojaxError: naming the fact, what was found and what is expected.
        """
        for each in dataclasses.fields(self):
            check_fact(each.name, getattr(self, each.name))
        if self.local_time_h is not None and self.beta_deg is not None:
            raise RpojaxError.of_argument("local_time_h, beta_deg", "found both, expected one of them")
        if self.approach_m is not None and self.approach_m >= self.hold_m:
            expected = f"less than hold_m = {self.hold_m:g}"
            raise RpojaxError.of_argument("approach_m", f"found {self.approach_m:g}, expected {expected}")
        if self.target_mesh is not None and self.span_m is not None:
            raise RpojaxError.of_argument("span_m", f"found {self.span_m:g} beside target_mesh, expected one of them")
        if self.mesh_units is not None and self.target_mesh is None:
            raise RpojaxError.of_argument("mesh_units", f"found {self.mesh_units!r}, expected it with target_mesh")
        if self.span_m is not None and self.span_m <= self.sides_m[1]:
            expected = f"more than the body, {self.sides_m[1]:g} m"
            raise RpojaxError.of_argument("span_m", f"found {self.span_m:g}, expected {expected}")

    @property
    def sides_m(self) -> tuple[float, float, float]:
        """Sides of the target's body [m]; panels lie along the second one."""
        one_or_three = self.target_m * (3 if len(self.target_m) == 1 else 1)
        return one_or_three[0], one_or_three[1], one_or_three[2]

    @property
    def nearest_m(self) -> float:
        """Distance of the last station [m]."""
        return self.hold_m if self.approach_m is None else self.approach_m

    @property
    def first_m(self) -> float:
        """Distance at the start [m]: with an approach that of the first station, else five thirds of the station's."""
        if self.start_m is not None:
            return self.start_m
        return self.hold_m if self.approach_m is not None else self.hold_m * 5.0 / 3.0


def check_fact(name: str, value: Any) -> None:
    """Refuses a fact outside of its limits.

    Raises:
        RpojaxError: naming the fact, what was found and what is expected.
    """
    limits = next(each for each in dataclasses.fields(MissionFacts) if each.name == name).metadata
    numbers = value if isinstance(value, tuple) else [value]
    for number in numbers:
        if isinstance(number, int | float) and not limits["low"] <= number <= limits["high"]:
            expected = f"{limits['low']:g} to {limits['high']:g}"
            raise RpojaxError.of_argument(name, f"found {number:g}, expected {expected}")
    if name == "target_m" and len(numbers) not in (1, 3):
        raise RpojaxError.of_argument(name, f"found {len(numbers)} sides, expected one or three")
