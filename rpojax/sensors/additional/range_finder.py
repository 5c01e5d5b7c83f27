"""Laser range finder: distance of the target's centre along the camera's boresight."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from rpojax.sensors.additional.additional_sensor import AdditionalSensor, SensedScene
from rpojax.value_types import Direction, Finite, NonNegative, Positive

if TYPE_CHECKING:
    import jax


class RangeFinder(AdditionalSensor):
    """Laser range finder; it needs no light, but the target within its beam."""

    noise_m: NonNegative
    bias_m: Finite
    maximum_range_m: Positive
    beam_half_angle_deg: Annotated[float, Field(gt=0.0, le=90.0, allow_inf_nan=False)]
    boresight: Direction

    normals: ClassVar[int] = 1

    @staticmethod
    def measure(
        settings: "Mapping[str, jax.Array]", scene: SensedScene, normals: "jax.Array"
    ) -> "dict[str, jax.Array]":
        """Measured range [m], NaN where there is none: `range_finder_m`.

        The settings are `noise`, `bias` and `maximum_range` [m], `beam_half_angle` [rad] and `boresight` (3,) in B.
        """
        import jax.numpy as jnp

        from rpojax.core import quaternion
        from rpojax.core.numerics import gradient_safe

        truth = scene.truth
        distance = gradient_safe.norm(truth.r_ST_N)
        line_B = quaternion.rotate(truth.q_BN, -gradient_safe.normalize(truth.r_ST_N))
        cosine = jnp.sum(line_B * gradient_safe.normalize(settings["boresight"]), axis=0)
        hit = (cosine >= jnp.cos(settings["beam_half_angle"])) & (distance <= settings["maximum_range"])
        measured = distance + settings["bias"] + settings["noise"] * normals[0]
        return {"range_finder_m": jnp.where(hit, measured, math.nan)}
