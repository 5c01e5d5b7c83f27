"""Random numbers of a tick as one vector, and the names of what makes runs differ, for a linear covariance."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.simulation.noise import TickNoise

HANDOVER, GPS_BIAS, GYRO_BIAS = "hand-over estimate", "GPS bias", "gyro bias"
STAR_TRACKER, GYRO, GPS, BOX = "star tracker noise", "gyro noise", "GPS noise", "box edge noise"
OUTLINE, BURN, DECISION = "target outline", "burn execution", "burn decision"


@dataclass(frozen=True)
class TickNoiseVector:
    """Random numbers of a tick as one vector, edges of the box in pixels.

    Attributes:
        substeps: gyro samples in a tick
    """

    substeps: int

    @property
    def slices(self) -> dict[str, slice]:
        """Name of the source -> where its numbers stand."""
        widths = {GPS: 3, STAR_TRACKER: 3, GYRO: 3 * self.substeps, BOX: 4, GPS_BIAS: 3, GYRO_BIAS: 3}
        edges = np.cumsum([0, *widths.values()]).tolist()
        return {name: slice(*edges[i : i + 2]) for i, name in enumerate(widths)}

    @property
    def size(self) -> int:
        """Numbers in all."""
        return max(part.stop for part in self.slices.values())

    def sigma(self, edge_noise_px: float) -> np.ndarray:
        """(size,) standard deviations."""
        sigma = np.ones(self.size)
        sigma[self.slices[BOX]] = edge_noise_px
        return sigma

    def unpack(self, vector: Array, nominal: TickNoise) -> TickNoise:
        """The numbers of a nominal tick with a vector added."""
        parts = self.slices
        box = jnp.concatenate([vector[parts[BOX]], jnp.zeros_like(nominal.camera[4:])])
        return TickNoise(
            gps=nominal.gps + vector[parts[GPS]],
            star_tracker=nominal.star_tracker + vector[parts[STAR_TRACKER]],
            gyro=nominal.gyro + vector[parts[GYRO]].reshape(self.substeps, 3),
            camera=nominal.camera + box,
            uniforms=nominal.uniforms,
            burn=nominal.burn,
            chamber_pressure=nominal.chamber_pressure,
            biases=nominal.biases + jnp.concatenate([vector[parts[GPS_BIAS]], vector[parts[GYRO_BIAS]]]),
            box_edge_errors=None,
        )


def zero_noise(substeps: int, edge_offset: Array, box_allowed: Array) -> TickNoise:
    """A tick without noise, with the box's edges displaced by `box` (4,) [px], and without a box unless `seen`."""
    zero = jnp.zeros((), dtype=jnp.float64)
    return TickNoise(
        gps=jnp.zeros(3),
        star_tracker=jnp.zeros(3),
        gyro=jnp.zeros((substeps, 3)),
        camera=jnp.concatenate([edge_offset, zero[None]]),
        # The first number is what a miss depends on, the second a false box.
        uniforms=jnp.ones(7).at[0].set(jnp.where(box_allowed, 1.0, -1.0)),
        burn=jnp.zeros(4),
        chamber_pressure=zero,
        biases=jnp.zeros(6),
        box_edge_errors=None,
    )


def source_names(found: Mapping[str, np.ndarray]) -> list[str]:
    """All sources, dispersions first."""
    own = (HANDOVER, GPS_BIAS, GYRO_BIAS, STAR_TRACKER, GYRO, GPS, BOX, OUTLINE, BURN, DECISION)
    return [*(name for name in found if name not in own), *own]
