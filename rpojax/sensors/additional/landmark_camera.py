"""Landmarks of the target in the pictures of the camera, as a network that finds them would give them.

They are seen past the target itself, in the light of the Sun or of the lamp, within the frame of the lens in use.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Final

from pydantic import Field

from rpojax.sensors.additional.additional_sensor import AdditionalSensor, SensedScene
from rpojax.value_types import Positive, Vector

if TYPE_CHECKING:
    import jax

    from rpojax.core.kalman_update import MeasurementRows
    from rpojax.flight.navigation.believed_sensor import SensorView

MOST: Final = 24
"""Landmarks of a target at most."""
_PER_LANDMARK: Final = 3
_Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class LandmarkCamera(AdditionalSensor):
    """What the camera shows of landmarks of the target, where `camera.landmarks` names some."""

    noise_px: Positive = 0.7
    shaded_noise_px: Positive = 1.2
    miss_probability: _Probability = 0.1
    shaded_miss_probability: _Probability = 0.5
    outlier_probability: _Probability = 0.02
    swap_probability: _Probability = 0.0
    minimum_size_px: Positive = 24.0
    body_offset_m: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    believed_noise_factor: Positive = 1.05

    normals: ClassVar[int] = _PER_LANDMARK * MOST + 2
    beliefs: ClassVar[tuple[str, ...]] = ("believed_noise_factor",)
    row_count: ClassVar[int] = 8
    shows_direction: ClassVar[bool] = True

    @staticmethod
    def measure(
        settings: "Mapping[str, jax.Array]", scene: SensedScene, normals: "jax.Array"
    ) -> "dict[str, jax.Array]":
        """Tangents right and down of the boresight (n,) of each landmark, NaN of those that are not found, and 1 sigma.

        In a rendered picture they are those of the network, of a statistical camera those of its statistics. The
        settings, of the geometric model, are `noise`, `shaded_noise` and `minimum_size` [px], `body_offset` (3,) [m] of
        the landmarks in T, and the probabilities of a miss in light and shade, of a place anywhere on the target, and
        of a picture in which the landmarks are taken for those of a symmetric attitude.
        """
        import jax.numpy as jnp
        from jax.scipy.special import ndtr

        picture = scene.landmarks
        assert picture is not None
        if picture.found is not None:
            return _shown(picture.found.tangents, picture.found.sigma, picture.found.present)
        seen, focal_px = picture.seen(settings["body_offset"]), picture.nominal_focal_px
        count = seen.lit.shape[0]
        drawn, of_picture = normals[: _PER_LANDMARK * count].reshape(_PER_LANDMARK, count), normals[-2:]
        chance = ndtr(drawn[0])
        noise = jnp.where(seen.lit, settings["noise"], settings["shaded_noise"]) / focal_px
        miss = jnp.where(seen.lit, settings["miss_probability"], settings["shaded_miss_probability"])
        places = seen.tangents + noise[:, None] * drawn[1:].T
        false = seen.middle[None, :] + seen.half_size * drawn[1:].T
        is_false = (chance >= miss) & (chance < miss + settings["outlier_probability"])
        places = jnp.where(is_false[:, None], false, places)
        large = 2.0 * seen.half_size * focal_px > settings["minimum_size"]
        found = seen.visible & (chance >= miss) & large & picture.observable & picture.working
        swapped = ndtr(of_picture[0]) < settings["swap_probability"]
        order = picture.order(swapped, ndtr(of_picture[1]))
        places, found, noise = places[order], found[order], noise[order]
        inside = jnp.all(jnp.abs(places) < picture.half_frame_tangent[None, :], axis=1)
        return _shown(places, noise, found & inside)

    @staticmethod
    def rows(
        beliefs: "Mapping[str, jax.Array]", view: "SensorView", measured: "Mapping[str, jax.Array]"
    ) -> "MeasurementRows":
        """Eight rows of all landmarks that are where the filter expects them."""
        from rpojax.flight.navigation import landmark_measurement, symmetric_landmarks

        assert view.target is not None
        found = landmark_measurement.picture(beliefs, view, measured)
        found = symmetric_landmarks.as_held(view.tuning, view.target, view.relative, found)
        return landmark_measurement.rows(view.tuning, view.target, view.relative, found)


def _shown(places: "jax.Array", sigma: "jax.Array", present: "jax.Array") -> "dict[str, jax.Array]":
    """Tangents (n, 2) and their sigma (n,) as measured, NaN of landmarks that are not present (n,)."""
    import jax.numpy as jnp

    shown = jnp.where(present[:, None], places, math.nan)
    return {
        "landmarks_right_tangent": shown[:, 0],
        "landmarks_down_tangent": shown[:, 1],
        "landmarks_sigma_tangent": jnp.where(present, sigma, math.nan),
    }
