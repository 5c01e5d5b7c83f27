"""What an additional sensor provides: the section of its settings, and its measurement."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rpojax.value_types import Section

if TYPE_CHECKING:
    import jax

    from rpojax.physics.environment.sun_moon_positions import SunMoonPositions
    from rpojax.physics.plant_state import Truth


@dataclass(frozen=True)
class SensedScene:
    """What a sensor measures at the beginning of a tick.

    Attributes:
        truth: state of the plant
        sky: positions of Sun and Moon
        time: () since the start of the run [s]
    """

    truth: "Truth"
    sky: "SunMoonPositions"
    time: "jax.Array"


class AdditionalSensor(Section, ABC):
    """Settings of an additional sensor, as a section of scenario files named like it.

    Its numbers can be dispersed. JAX is imported inside of `measure`, so that scenarios are validated without it.
    """

    normals: ClassVar[int]
    """Standard normal numbers that a measurement takes."""

    @staticmethod
    @abstractmethod
    def measure(
        settings: "Mapping[str, jax.Array]", scene: SensedScene, normals: "jax.Array"
    ) -> "dict[str, jax.Array]":
        """Measurements of one tick.

        Args:
            settings: numbers of the section in SI and radians, by name without unit
            scene: what there is to measure
            normals: (n,) standard normal numbers

        Returns:
            measurement by name, which is a recorded channel too and ends with its unit; numbers, vectors or flags.
        """
