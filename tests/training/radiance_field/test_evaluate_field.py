"""Metrics of identical images."""

import pytest

from rpojax.training.radiance_field import evaluate_field
from rpojax.training.synthetic_data.ray_traced_views import Views


def test_metrics_of_identical_images_are_perfect(views: Views) -> None:
    found = evaluate_field.field_metrics(
        evaluate_field.RenderedViews(views.radiance(evaluate_field.FILL_LIGHT), views.alpha), views
    )
    assert found["psnr_db"] == 100.0
    assert found["ssim"] == pytest.approx(1.0)
    assert found["silhouette_iou"] == found["box_iou_median"] == 1.0
