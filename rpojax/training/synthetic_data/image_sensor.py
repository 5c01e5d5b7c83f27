"""Image sensor of synthetic images: shot and read noise, blur, sRGB encoding."""

import dataclasses

import cv2
import numpy as np

from rpojax.vision.imaging.srgb import linear_to_srgb_numpy


@dataclasses.dataclass(frozen=True)
class ImageSensor:
    """Electrons at white level, and read noise [electrons, 1 sigma]."""

    full_well_e: float
    read_noise_e: float

    def noise_sigma(self, image: np.ndarray) -> np.ndarray:
        """1 sigma of every value of a linear image."""
        electrons = np.maximum(image, 0.0) * self.full_well_e
        return np.sqrt(electrons + self.read_noise_e**2) / self.full_well_e


def expose_image(rng: np.random.Generator, image: np.ndarray, sensor: ImageSensor) -> np.ndarray:
    """8 bit sRGB codes (p, p, 3) of a linear image after blur, shot and read noise."""
    blurred = np.maximum(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.2, 0.9))), 0.0)
    noisy = blurred + sensor.noise_sigma(blurred) * rng.normal(size=image.shape)
    return np.round(255.0 * linear_to_srgb_numpy(noisy)).astype(np.uint8)
