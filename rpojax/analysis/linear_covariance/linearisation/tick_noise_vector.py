"""Random numbers of a tick as one vector, for a linear covariance."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.analysis.linear_covariance.linearisation.error_sources import (
    BOX,
    GPS,
    GPS_BIAS,
    GYRO,
    GYRO_BIAS,
    STAR_TRACKER,
)
from rpojax.simulation.noise import TickNoise


@dataclass(frozen=True)
class TickNoiseVector:
    """Layout of the random numbers of a tick in one vector; box edges are in pixels.

    Attributes:
        substeps: gyro samples in a tick
    """

    substeps: int

    @property
    def slices(self) -> dict[str, slice]:
        """Slice of each source by its name."""
        widths = {GPS: 3, STAR_TRACKER: 3, GYRO: 3 * self.substeps, BOX: 4, GPS_BIAS: 3, GYRO_BIAS: 3}
        edges = np.cumsum([0, *widths.values()]).tolist()
        return {name: slice(*edges[i : i + 2]) for i, name in enumerate(widths)}

    @property
    def size(self) -> int:
        """Length of the vector."""
        return max(part.stop for part in self.slices.values())

    def sigma(self, edge_noise_px: float) -> np.ndarray:
        """(size,) standard deviations."""
        sigma = np.ones(self.size)
        sigma[self.slices[BOX]] = edge_noise_px
        return sigma

    def unpack(self, vector: Array, nominal: TickNoise) -> TickNoise:
        """Noise of a nominal tick with the deviations of a vector (size,) added."""
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
    """Zero noise of a tick, with the box displaced by `edge_offset` (4,) [px], and missed unless `box_allowed`."""
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
