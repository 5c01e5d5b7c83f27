"""Evaluation of a radiance field: its images against ray-traced ones."""

import dataclasses
from collections.abc import Callable

import cv2
import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.imaging.srgb import linear_to_srgb
from rpojax.vision.intersection_over_union import intersection_over_union
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.ray_budget import choose_ray_sampling
from rpojax.vision.radiance_field.render_image import Light, render_target
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_EDGE_ALPHA = 0.1
"""Least alpha of a pixel at the edge of a silhouette."""
_COVERED_ALPHA = 0.02
_LEAST_PEAK = 1e-3
FILL_LIGHT = 0.1
"""Irradiance by fill light in views that are compared, by the Sun's: Earth-shine in the morning."""


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


@dataclasses.dataclass(frozen=True)
class RenderedViews:
    """Linear colour (n, p, p, 3) and alpha (n, p, p) of rendered views."""

    rgb: np.ndarray
    alpha: np.ndarray


def render_views(
    field: RadianceField, views: Views, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> RenderedViews:
    """Views of a field with the poses and lights of ray-traced ones, by the renderer of the simulator."""
    size = views.alpha.shape[1]
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(views.field_of_view_deg)), size, size)
    center = np.asarray(bounding_sphere(field)[0])
    min_range_m = float(np.linalg.norm(views.position - center, axis=1).min())
    sampling = choose_ray_sampling(field, float(intrinsics.focal_px), min_range_m, oversampling=1.0)

    @jax.jit
    def render_view(
        field: RadianceField, position: jax.Array, rotation: jax.Array, sun: jax.Array, fill: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        light = Light(sun_T=sun, sunlight=jnp.float32(1.0), fill_T=fill, fill=jnp.float32(FILL_LIGHT))
        frame = render_target(field, intrinsics, size, size, sampling, position, rotation, light)
        return frame.color, frame.alpha

    colors, alphas = [], []
    for index in range(len(views)):
        parts = (jnp.asarray(v[index], jnp.float32) for v in (views.position, views.rotation, views.sun, views.fill))
        color, alpha = render_view(field, *parts)
        colors.append(np.asarray(color))
        alphas.append(np.asarray(alpha))
        on_progress(index + 1, len(views))
    return RenderedViews(np.stack(colors), np.stack(alphas))


def field_metrics(rendered: RenderedViews, views: Views) -> dict[str, float]:
    """Metrics of `rpojax field evaluate`.

    PSNR over all pixels of all views, means of SSIM and IoU, medians of the box IoU, of the brightest value of a view
    (1 = white level), and of that by the ray trace's.
    """
    rows = metrics_per_view(rendered, views)
    covered = views.alpha > _COVERED_ALPHA
    square = _squared_errors(rendered, views)
    return {
        "psnr_db": psnr(square),
        "psnr_target_db": psnr(square[covered]),
        "ssim": float(np.mean(rows["ssim"])),
        "silhouette_iou": float(np.mean(rows["silhouette_iou"])),
        "box_iou_median": float(np.median(rows["box_iou"])),
        "peak_over_white_median": float(np.median(rows["peak"])),
        "peak_by_trace_median": float(np.median(rows["peak_by_trace"])),
    }


def metrics_per_view(rendered: RenderedViews, views: Views) -> dict[str, np.ndarray]:
    """The same metrics for every view."""
    square = _squared_errors(rendered, views)
    covered = views.alpha > _COVERED_ALPHA
    count = range(len(views))
    radiance = views.radiance(FILL_LIGHT)
    shown, traced = srgb_codes(rendered.rgb), srgb_codes(radiance)
    peak = rendered.rgb.max(axis=(1, 2, 3))
    return {
        "psnr_db": np.array([psnr(square[i]) for i in count]),
        "psnr_target_db": np.array([psnr(square[i][covered[i]]) for i in count]),
        "ssim": np.array([ssim(shown[i], traced[i]) for i in count]),
        "silhouette_iou": np.array([mask_iou(rendered.alpha[i] > 0.5, views.alpha[i] > 0.5) for i in count]),
        "peak": peak,
        "peak_by_trace": peak / np.maximum(radiance.max(axis=(1, 2, 3)), _LEAST_PEAK),
        "box_iou": intersection_over_union(
            *(np.array([silhouette_box(alpha) for alpha in alphas]) for alphas in (rendered.alpha, views.alpha))
        ),
    }


def _squared_errors(rendered: RenderedViews, views: Views) -> np.ndarray:
    return (srgb_codes(rendered.rgb).astype(np.float64) - srgb_codes(views.radiance(FILL_LIGHT))) ** 2
