"""Laser range finder: distance of the nearest surface of the target in a narrow beam along its boresight."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Final

from pydantic import Field

from rpojax.sensors.additional.additional_sensor import AdditionalSensor, SensedScene
from rpojax.value_types import Direction, Finite, NonNegative, Positive

if TYPE_CHECKING:
    import jax

    from rpojax.core.kalman_update import MeasurementRows
    from rpojax.flight.navigation.believed_sensor import SensorView
    from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

_RING: Final = 6
"""Rays of the beam beside that in its middle."""
_RING_SHARE: Final = 0.7
"""Angle of these rays from the boresight over the half-angle of the beam: half of its area is within."""


class RangeFinder(AdditionalSensor):
    """Laser range finder, which needs no light: the nearest return of its beam is the range."""

    noise_m: NonNegative
    bias_m: Finite
    maximum_range_m: Positive
    beam_half_angle_deg: Annotated[float, Field(gt=0.0, le=10.0, allow_inf_nan=False)]
    boresight: Direction
    believed_noise_m: Positive

    normals: ClassVar[int] = 1
    beliefs: ClassVar[tuple[str, ...]] = ("believed_noise_m",)
    row_count: ClassVar[int] = 1
    meets_surface: ClassVar[bool] = True

    @staticmethod
    def measure(
        settings: "Mapping[str, jax.Array]", scene: SensedScene, normals: "jax.Array"
    ) -> "dict[str, jax.Array]":
        """Measured range [m], NaN where there is none: `range_finder_m`.

        The settings are `noise`, `bias` and `maximum_range` [m], `beam_half_angle` [rad] and `boresight` (3,) in B.
        """
        import jax.numpy as jnp
        import numpy as np

        from rpojax.core.numerics import gradient_safe
        from rpojax.sensors.additional import surface_ranging

        assert scene.surface is not None
        angles = 2.0 * np.pi * np.arange(_RING) / _RING
        ring = _RING_SHARE * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        boresight = gradient_safe.normalize(settings["boresight"])
        pattern = jnp.asarray(np.concatenate([np.zeros((1, 2)), ring]), dtype=boresight.dtype)
        beam = surface_ranging.within_cone(boresight, settings["beam_half_angle"], pattern)
        found = surface_ranging.returns(scene.truth, scene.surface, beam, settings["maximum_range"])
        hit = jnp.any(found.present, axis=0)
        distance = jnp.min(jnp.where(found.present, found.distance, jnp.inf), axis=0)
        measured = jnp.where(hit, distance, 0.0) + settings["bias"] + settings["noise"] * normals[0]
        return {"range_finder_m": jnp.where(hit, measured, math.nan)}

    @staticmethod
    def rows(
        beliefs: "Mapping[str, jax.Array]", view: "SensorView", measured: "Mapping[str, jax.Array]"
    ) -> "MeasurementRows":
        """Range of the centre of mass less that of the nearest surface from it, whose error is a state."""
        import jax.numpy as jnp

        from rpojax.core.numerics import gradient_safe

        def expected(estimate: "RelativeEstimate") -> "jax.Array":
            offset = view.tuning.nearest_surface * view.tuning.target_size + jnp.sum(
                estimate.slow["nearest_surface"], axis=0
            )
            return (gradient_safe.norm(estimate.r_TS_N) - offset)[None]

        values, variance = measured["range_finder_m"][None], beliefs["believed_noise"][None] ** 2
        return view.rows(expected, values, variance, jnp.isfinite(values[0]))
