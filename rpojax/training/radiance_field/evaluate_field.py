"""How well a field renders: its pictures against ray-traced ones."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.synthetic_data.ray_tracing import Views
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.ray_budget import choose_ray_sampling
from rpojax.vision.radiance_field.render_image import linear_to_srgb, render_target
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_COVERED_ALPHA = 0.02
_EDGE_ALPHA = 0.1


@dataclasses.dataclass(frozen=True)
class RenderedViews:
    """Linear colour (n, p, p, 3) and alpha (n, p, p) of a field's views."""

    rgb: np.ndarray
    alpha: np.ndarray


def render_views(
    field: RadianceField, views: Views, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> RenderedViews:
    """The field's renderings of ray-traced views, through the renderer that the simulator uses."""
    size = views.alpha.shape[1]
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(views.field_of_view_deg)), size, size)
    middle = np.asarray(bounding_sphere(field)[0])
    min_range_m = float(np.linalg.norm(views.position - middle, axis=1).min())
    sampling = choose_ray_sampling(field, float(intrinsics.focal_px), min_range_m, oversampling=1.0)

    @jax.jit
    def one(
        field: RadianceField, position: jax.Array, rotation: jax.Array, sun: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        lit = jnp.ones((), jnp.float32)
        frame = render_target(field, intrinsics, size, size, sampling, position, rotation, sun, lit)
        return frame.color, frame.alpha

    colors, alphas = [], []
    for index in range(len(views)):
        parts = (jnp.asarray(v[index], jnp.float32) for v in (views.position, views.rotation, views.sun))
        color, alpha = one(field, *parts)
        colors.append(np.asarray(color))
        alphas.append(np.asarray(alpha))
        on_progress(index + 1, len(views))
    return RenderedViews(np.stack(colors), np.stack(alphas))


def field_metrics(shown: RenderedViews, views: Views) -> dict[str, float]:
    """The figures of `rpojax field evaluate`: errors of sRGB codes over all pixels of all views, and medians of IoU."""
    rows = metrics_per_view(shown, views)
    covered = views.alpha > _COVERED_ALPHA
    square = _squared_errors(shown, views)
    return {
        "psnr_db": psnr(square),
        "psnr_target_db": psnr(square[covered]),
        "ssim": float(np.mean(rows["ssim"])),
        "silhouette_iou": float(np.mean(rows["silhouette_iou"])),
        "box_iou_median": float(np.median(rows["box_iou"])),
    }


def metrics_per_view(shown: RenderedViews, views: Views) -> dict[str, np.ndarray]:
    """The same figures for every view."""
    square = _squared_errors(shown, views)
    covered = views.alpha > _COVERED_ALPHA
    count = range(len(views))
    return {
        "psnr_db": np.array([psnr(square[i]) for i in count]),
        "psnr_target_db": np.array([psnr(square[i][covered[i]]) for i in count]),
        "ssim": np.array([ssim(srgb_codes(shown.rgb[i]), srgb_codes(views.rgb[i])) for i in count]),
        "silhouette_iou": np.array([_mask_iou(shown.alpha[i] > 0.5, views.alpha[i] > 0.5) for i in count]),
        "box_iou": np.array([box_iou(silhouette_box(shown.alpha[i]), silhouette_box(views.alpha[i])) for i in count]),
    }


def srgb_codes(linear: np.ndarray) -> np.ndarray:
    """sRGB code values (0..1) of linear radiance."""
    return np.asarray(linear_to_srgb(jnp.asarray(linear, jnp.float32)))


def _squared_errors(shown: RenderedViews, views: Views) -> np.ndarray:
    return (srgb_codes(shown.rgb).astype(np.float64) - srgb_codes(views.rgb)) ** 2


def psnr(squared_errors: np.ndarray) -> float:
    """Peak signal to noise [dB] of squared errors of code values; 100 dB at most."""
    return float(-10.0 * np.log10(max(float(np.mean(squared_errors)), 1e-10))) if squared_errors.size else float("nan")


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity of two pictures (p, p, 3), Gaussian window of sigma 1.5 px (Wang et al., 2004)."""
    import cv2

    def blur(picture: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(picture, (11, 11), 1.5)

    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, cov = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    ratio = (2 * mean_a * mean_b + c1) * (2 * cov + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    return float(ratio.mean())


def silhouette_box(alpha: np.ndarray) -> np.ndarray:
    """Left, top, right, bottom [px] of a silhouette; a pixel at the edge counts by the share that is covered."""
    edges = []
    for axis in (0, 1):
        profile = alpha.max(axis=axis)
        found = np.nonzero(profile > _EDGE_ALPHA)[0]
        if len(found) == 0:
            return np.zeros(4)
        first, last = found[0], found[-1]
        edges.append((first + 1.0 - profile[first], last + profile[last]))
    return np.array([edges[0][0], edges[1][0], edges[0][1], edges[1][1]])


def box_iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two boxes."""
    sides = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0)
    intersection = float(np.prod(sides))
    union = float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - intersection
    return intersection / union if union > 0.0 else 0.0


def _mask_iou(a: np.ndarray, b: np.ndarray) -> float:
    union = int((a | b).sum())
    return float((a & b).sum()) / union if union else 0.0
