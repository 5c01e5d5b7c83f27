"""LiDAR: 64 beams a tick in a pattern about the predicted target, of which the filter gets the centroid of the returns.

A flash LiDAR takes them at one instant. For a scanning one this leaves out by how far the target turns within a scan.
"""

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

RAYS: Final = 64
_TURN_RATE: Final = 2.399963
"""Rate at which the pattern turns [rad/s]: by the golden angle in a second, so that frames meet other places."""
_SPREAD: Final = 0.22
"""Distance of a return from the centroid of the surface in sight along an axis, over the target's size, 1 sigma [-]: by
the scatter of the packaged target's centroid at 3 to 50 m (experiments/close_range/centroid.py). The centroid of evenly
spread places is nearer to that of the surface than of independent ones: their error falls with the number to the power
of -3/4 (Kendall, On the Number of Lattice Points inside a Random Oval, 1948)."""


class Lidar(AdditionalSensor):
    """Scanning or flash LiDAR, which needs no light."""

    noise_m: NonNegative
    bias_m: Finite
    angle_noise_deg: NonNegative
    maximum_range_m: Positive
    field_half_angle_deg: Annotated[float, Field(gt=0.0, le=60.0, allow_inf_nan=False)]
    boresight: Direction
    believed_noise_m: Positive
    believed_angle_noise_deg: Positive

    normals: ClassVar[int] = 3
    beliefs: ClassVar[tuple[str, ...]] = ("believed_noise_m", "believed_angle_noise_deg")
    row_count: ClassVar[int] = 3
    shows_direction: ClassVar[bool] = True
    meets_surface: ClassVar[bool] = True

    @staticmethod
    def measure(
        settings: "Mapping[str, jax.Array]", scene: SensedScene, normals: "jax.Array"
    ) -> "dict[str, jax.Array]":
        """Centroid (3,) of the returns in B [m], `lidar_centroid_m`, NaN where there is none; `lidar_returns_count`.

        The settings are `noise`, `bias` and `maximum_range` [m], `angle_noise` and `field_half_angle` [rad], and
        `boresight` (3,) in B. White noise of single ranges is drawn as that of their mean.
        """
        import jax.numpy as jnp

        from rpojax.core import vectors
        from rpojax.core.numerics import gradient_safe
        from rpojax.sensors.additional import surface_ranging

        cone, field = scene.cone, settings["field_half_angle"]
        assert cone is not None
        assert scene.surface is not None
        turned = _TURN_RATE * scene.time
        c, s = jnp.cos(turned), jnp.sin(turned)
        x, y = jnp.asarray(surface_ranging.sunflower(RAYS), dtype=c.dtype).T
        pattern = jnp.stack([c * x - s * y, s * x + c * y], axis=1)
        beams = surface_ranging.within_cone(cone.axis_B, jnp.minimum(cone.half_angle, field), pattern)
        found = surface_ranging.returns(scene.truth, scene.surface, beams, settings["maximum_range"])
        present = found.present & surface_ranging.is_within(beams, settings["boresight"], field)
        count = jnp.sum(jnp.where(present, 1.0, 0.0), axis=0)
        hit = count > 0.5
        # A return stands for the surface across its beam, of a pattern that is even in the plane across its axis.
        distance = jnp.where(present, found.distance, 0.0)
        surface = distance**2 * jnp.sum(beams * cone.axis_B[None, :], axis=1) ** 3
        share = surface / jnp.where(hit, jnp.sum(surface, axis=0), 1.0)
        mean = jnp.sum(beams * (share * distance)[:, None], axis=0)
        line = jnp.where(hit, gradient_safe.normalize(jnp.where(hit, mean, cone.axis_B)), cone.axis_B)
        first, second = vectors.across_axes(line)
        along = settings["bias"] + settings["noise"] * normals[0] * gradient_safe.norm(share)
        across = settings["angle_noise"] * gradient_safe.norm(jnp.where(hit, mean, cone.axis_B))
        centroid = mean + along * line + across * (normals[1] * first + normals[2] * second)
        return {"lidar_centroid_m": jnp.where(hit, centroid, math.nan), "lidar_returns_count": count}

    @staticmethod
    def rows(
        beliefs: "Mapping[str, jax.Array]", view: "SensorView", measured: "Mapping[str, jax.Array]"
    ) -> "MeasurementRows":
        """Centroid along the predicted line of sight and across, where its offset from the centre of mass is a state.

        Along the measured line, which has the error of the rows across, these would seem to measure the range.
        """
        import jax.numpy as jnp

        from rpojax.core import quaternion, vectors
        from rpojax.core.numerics import gradient_safe

        tuning, present = view.tuning, measured["lidar_returns_count"] > 0.5
        forward = jnp.array([1.0, 0.0, 0.0], dtype=view.q_BN.dtype)
        centroid = jnp.where(present, measured["lidar_centroid_m"], forward)
        distance = gradient_safe.norm(centroid)
        line = gradient_safe.normalize(quaternion.rotate(view.q_BN, view.relative.r_TS_N))
        axes = jnp.stack([line, *vectors.across_axes(line)])

        def expected(estimate: "RelativeEstimate") -> "jax.Array":
            place = jnp.sum(axes * quaternion.rotate(view.q_BN, estimate.r_TS_N)[None, :], axis=1)
            offset = estimate.slow["centroid"]
            toward = tuning.centroid * tuning.target_size + offset[0] + offset[1]
            return place + jnp.stack([-toward, offset[2] + offset[4], offset[3] + offset[5]])

        number = jnp.maximum(measured["lidar_returns_count"], 1.0)
        sampling = (_SPREAD * tuning.target_size) ** 2 / (number * jnp.sqrt(number))
        along = beliefs["believed_noise"] ** 2 / number + sampling
        across = (beliefs["believed_angle_noise"] * distance) ** 2 + sampling
        values = jnp.sum(axes * centroid[None, :], axis=1)
        return view.rows(expected, values, jnp.stack([along, across, across]), present)
