"""What an additional sensor provides: the section of its settings, and its measurement."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rpojax.value_types import Finite, NonNegative, Section

if TYPE_CHECKING:
    import jax

    from rpojax.core.kalman_update import MeasurementRows
    from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
    from rpojax.flight.guidance.sight_cone import SightCone
    from rpojax.flight.navigation.believed_sensor import SensorView
    from rpojax.physics.plant_state import Truth
    from rpojax.sensors.additional.landmark_scene import LandmarkScene
    from rpojax.sensors.additional.surface_ranging import TargetSurface


@dataclass(frozen=True)
class SensedScene:
    """What a sensor measures at the beginning of a tick.

    Attributes:
        truth: state of the plant
        sky: positions of Sun and Moon
        time: () since the start of the run [s]
        surface: of the target, None unless a sensor of the scenario meets it
        cone: directions in which flight software looks for the target, None likewise
        landmarks: of the target before the camera, None unless a sensor finds them
    """

    truth: "Truth"
    sky: "SunMoonPositions"
    time: "jax.Array"
    surface: "TargetSurface | None" = None
    cone: "SightCone | None" = None
    landmarks: "LandmarkScene | None" = None


class AdditionalSensor(Section, ABC):
    """Settings of an additional sensor, as a section of scenario files named like it.

    Its numbers can be dispersed. JAX is imported inside of `measure`, so that scenarios are validated without it. The
    orbit filter believes a sensor whose class has `rows`.
    """

    delay_s: NonNegative = 0.0
    delay_jitter_s: NonNegative = 0.0
    processing_s: NonNegative = 0.0
    time_tag_error_s: Finite = 0.0

    normals: ClassVar[int]
    """Standard normal numbers that a measurement takes."""
    beliefs: ClassVar[tuple[str, ...]] = ()
    """Keys of the section that flight software alone has: what it believes of the sensor."""
    shows_direction: ClassVar[bool] = False
    """A measurement that the filter used means that the target is where the servicer looks for it, as a box does."""
    meets_surface: ClassVar[bool] = False
    """It measures the surface of the target."""
    row_count: ClassVar[int] = 0
    """Rows of a measurement in the filter, 0 for a sensor that it does not believe."""

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

    @staticmethod
    def rows(
        beliefs: "Mapping[str, jax.Array]", view: "SensorView", measured: "Mapping[str, jax.Array]"
    ) -> "MeasurementRows":
        """Rows (m) of the measurement of a tick for the relative orbit filter.

        Args:
            beliefs: numbers of the section that `beliefs` names, in SI and radians, by name without unit
            view: estimates before the measurement; its `rows` linearises
            measured: measurements of all additional sensors by name
        """
        raise NotImplementedError

    @classmethod
    def is_believed(cls) -> bool:
        """Whether the orbit filter uses the measurement."""
        return cls.row_count > 0
