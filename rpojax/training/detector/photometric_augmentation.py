"""Photometric augmentation of images: exposure, glare, blur, noise, colour, compression."""

import cv2
import numpy as np

Rng = np.random.Generator

NOISE_SIDE_PX = 512
"""Side of the square of standard normal numbers from which noise is cropped."""


def augment_appearance(rng: Rng, image: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Codes (p, p, 3) in 0..1 float32 after random changes of tone, glare, blur, noise, colour and compression."""
    values = np.ascontiguousarray(image).astype(np.float32) / np.float32(255.0)
    if rng.random() < 0.5:
        values = _random_tone(rng, values)
    if rng.random() < 0.08:
        values = values + _glare(rng, values.shape[0])
    if rng.random() < 0.12:
        bright = np.maximum(values - np.float32(rng.uniform(0.4, 0.8)), 0.0)
        values = values + np.float32(rng.uniform(0.3, 1.5)) * cv2.GaussianBlur(bright, (0, 0), rng.uniform(2.0, 8.0))
    if rng.random() < 0.2:
        values = cv2.GaussianBlur(values, (0, 0), float(rng.uniform(0.3, 1.4)))
    if rng.random() < 0.1:
        soft = cv2.GaussianBlur(values, (0, 0), 1.0)
        values = values + np.float32(rng.uniform(0.3, 1.2)) * (values - soft)
    if rng.random() < 0.3:
        values = values + np.float32(np.exp(rng.uniform(np.log(0.004), np.log(0.05)))) * _noise_crop(
            rng, noise, values.shape
        )
    if rng.random() < 0.25:
        values = np.repeat(values @ np.array([[0.299], [0.587], [0.114]], np.float32), 3, axis=2)
    values = np.clip(values, 0.0, 1.0)
    if rng.random() < 0.15:
        quality = int(rng.integers(30, 95))
        packed = cv2.imencode(".jpg", np.round(255.0 * values).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        values = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)).astype(np.float32) / np.float32(255.0)
    return values.astype(np.float32)


def _random_tone(rng: Rng, values: np.ndarray) -> np.ndarray:
    """Random exposure, contrast curve and colour balance."""
    gain = np.float32(np.exp(rng.normal(scale=0.35)))
    tint = (1.0 + rng.normal(scale=0.06, size=3)).astype(np.float32)
    offset = np.float32(max(0.0, rng.normal(scale=0.02)))
    return np.clip(gain * tint * values, 0.0, 2.0) ** np.float32(np.exp(rng.normal(scale=0.2))) + offset


def _glare(rng: Rng, size: int) -> np.ndarray:
    """Glare of the Sun in or near the frame."""
    y, x = np.mgrid[:size, :size].astype(np.float32)
    center = rng.uniform(-0.3, 1.3, 2).astype(np.float32) * size
    distance = np.hypot(x - center[0], y - center[1]) / np.float32(size)
    light = np.float32(rng.uniform(0.05, 0.5)) * np.exp(-distance / np.float32(rng.uniform(0.05, 0.5)))
    return light[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32)


def _noise_crop(rng: Rng, noise: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    row, column = rng.integers(0, NOISE_SIDE_PX - shape[0], 2)
    return noise[row : row + shape[0], column : column + shape[1]]
