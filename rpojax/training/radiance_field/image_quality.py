"""Image quality: PSNR and SSIM of sRGB codes, boxes and agreement of silhouettes."""

import cv2
import jax.numpy as jnp
import numpy as np

from rpojax.vision.imaging.srgb import linear_to_srgb

_EDGE_ALPHA = 0.1
"""Least alpha of a pixel at the edge of a silhouette."""


def srgb_codes(linear: np.ndarray) -> np.ndarray:
    """sRGB codes in 0..1 of linear radiance."""
    return np.asarray(linear_to_srgb(jnp.asarray(linear, jnp.float32)))


def psnr(squared_errors: np.ndarray) -> float:
    """Peak signal-to-noise ratio [dB] of squared errors of codes in 0..1; at most 100 dB."""
    return float(-10.0 * np.log10(max(float(np.mean(squared_errors)), 1e-10))) if squared_errors.size else float("nan")


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity of two images (p, p, 3), Gaussian window of sigma 1.5 px (Wang et al., 2004)."""

    def blur(image: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(image, (11, 11), 1.5)

    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, cov = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    ratio = (2 * mean_a * mean_b + c1) * (2 * cov + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    return float(ratio.mean())


def silhouette_box(alpha: np.ndarray) -> np.ndarray:
    """Left, top, right, bottom [px] of a silhouette; a pixel at its edge counts by its alpha."""
    edges = []
    for axis in (0, 1):
        profile = alpha.max(axis=axis)
        found = np.nonzero(profile > _EDGE_ALPHA)[0]
        if len(found) == 0:
            return np.zeros(4)
        first, last = found[0], found[-1]
        edges.append((first + 1.0 - profile[first], last + profile[last]))
    return np.array([edges[0][0], edges[1][0], edges[0][1], edges[1][1]])


def mask_iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two masks; 0 where both are empty."""
    union = int((a | b).sum())
    return float((a & b).sum()) / union if union else 0.0
