"""Image sensor of synthetic images: shot and read noise, blur, sRGB encoding."""

import dataclasses

import cv2
import numpy as np

from rpojax.vision.imaging.srgb import linear_to_srgb_numpy

Rng = np.random.Generator


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


def add_artefacts(rng: Rng, image: np.ndarray) -> np.ndarray:
    """The image with random camera artefacts: hot pixels, particle tracks, ghosts of the Sun."""
    size = image.shape[0]
    image = np.ascontiguousarray(image, np.float32)
    if rng.random() < 0.12:
        for _ in range(int(rng.integers(1, 8))):
            row, column = rng.integers(0, size, 2)
            image[row, column] += np.float32(rng.uniform(0.05, 1.0)) * rng.uniform(0.2, 1.0, 3).astype(np.float32)
    if rng.random() < 0.06:
        start = rng.integers(0, size, 2)
        end = start + rng.integers(-12, 13, 2)
        track = np.zeros((size, size), np.float32)
        cv2.line(track, tuple(map(int, start)), tuple(map(int, end)), float(rng.uniform(0.1, 1.0)), 1, cv2.LINE_AA)
        image = image + track[..., None]
    if rng.random() < 0.08:
        y, x = np.mgrid[:size, :size].astype(np.float32)
        for _ in range(int(rng.integers(1, 4))):
            center, radius = rng.uniform(0.0, size, 2), rng.uniform(3.0, 40.0)
            disc = 1.0 / (1.0 + np.exp((np.hypot(x - center[0], y - center[1]) - radius) / rng.uniform(0.5, 6.0)))
            image = image + np.float32(rng.uniform(0.005, 0.15)) * disc[..., None] * rng.uniform(0.3, 1.0, 3)
    return image.astype(np.float32)
