"""Evaluation of a radiance field: its images against ray-traced ones."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.radiance_field.image_quality import mask_iou, psnr, silhouette_box, srgb_codes, ssim
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.intersection_over_union import intersection_over_union
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.ray_budget import choose_ray_sampling
from rpojax.vision.radiance_field.render_image import render_target
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_COVERED_ALPHA = 0.02


@dataclasses.dataclass(frozen=True)
class RenderedViews:
    """Linear colour (n, p, p, 3) and alpha (n, p, p) of rendered views."""

    rgb: np.ndarray
    alpha: np.ndarray


def render_views(
    field: RadianceField, views: Views, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> RenderedViews:
    """Views of a field with the poses and Suns of ray-traced ones, by the renderer of the simulator."""
    size = views.alpha.shape[1]
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(views.field_of_view_deg)), size, size)
    center = np.asarray(bounding_sphere(field)[0])
    min_range_m = float(np.linalg.norm(views.position - center, axis=1).min())
    sampling = choose_ray_sampling(field, float(intrinsics.focal_px), min_range_m, oversampling=1.0)

    @jax.jit
    def render_view(
        field: RadianceField, position: jax.Array, rotation: jax.Array, sun: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        lit = jnp.ones((), jnp.float32)
        frame = render_target(field, intrinsics, size, size, sampling, position, rotation, sun, lit)
        return frame.color, frame.alpha

    colors, alphas = [], []
    for index in range(len(views)):
        parts = (jnp.asarray(v[index], jnp.float32) for v in (views.position, views.rotation, views.sun))
        color, alpha = render_view(field, *parts)
        colors.append(np.asarray(color))
        alphas.append(np.asarray(alpha))
        on_progress(index + 1, len(views))
    return RenderedViews(np.stack(colors), np.stack(alphas))


def field_metrics(rendered: RenderedViews, views: Views) -> dict[str, float]:
    """Metrics of `rpojax field evaluate`: PSNR over all pixels of all views, means of SSIM and IoU, median box IoU."""
    rows = metrics_per_view(rendered, views)
    covered = views.alpha > _COVERED_ALPHA
    square = _squared_errors(rendered, views)
    return {
        "psnr_db": psnr(square),
        "psnr_target_db": psnr(square[covered]),
        "ssim": float(np.mean(rows["ssim"])),
        "silhouette_iou": float(np.mean(rows["silhouette_iou"])),
        "box_iou_median": float(np.median(rows["box_iou"])),
    }


def metrics_per_view(rendered: RenderedViews, views: Views) -> dict[str, np.ndarray]:
    """The same metrics for every view."""
    square = _squared_errors(rendered, views)
    covered = views.alpha > _COVERED_ALPHA
    count = range(len(views))
    return {
        "psnr_db": np.array([psnr(square[i]) for i in count]),
        "psnr_target_db": np.array([psnr(square[i][covered[i]]) for i in count]),
        "ssim": np.array([ssim(srgb_codes(rendered.rgb[i]), srgb_codes(views.rgb[i])) for i in count]),
        "silhouette_iou": np.array([mask_iou(rendered.alpha[i] > 0.5, views.alpha[i] > 0.5) for i in count]),
        "box_iou": intersection_over_union(
            *(np.array([silhouette_box(alpha) for alpha in alphas]) for alphas in (rendered.alpha, views.alpha))
        ),
    }


def _squared_errors(rendered: RenderedViews, views: Views) -> np.ndarray:
    return (srgb_codes(rendered.rgb).astype(np.float64) - srgb_codes(views.rgb)) ** 2
