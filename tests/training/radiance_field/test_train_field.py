"""Training lowers the error, goes on after an interrupt, and ends in a field that judges well."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.training.radiance_field import evaluate_field, image_quality, train_field
from rpojax.training.radiance_field.train_field import FieldTrainingOptions, FieldTrainingProgress
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.radiance_field.grid_field import GridField
from rpojax.vision.radiance_field.target_field import RadianceField

SHORT = FieldTrainingOptions(steps=750, rays=256, rows=8000)


@pytest.fixture(scope="module")
def trained(box: TargetMesh, views: Views) -> tuple[RadianceField, list[FieldTrainingProgress]]:
    """A short training without interruption: compiling it takes longer than its steps."""
    return train_field.train(box, views, SHORT)


def nothing(views: Views) -> evaluate_field.RenderedViews:
    """Black pictures: what a field without matter shows."""
    return evaluate_field.RenderedViews(np.zeros_like(views.rgb), np.zeros_like(views.alpha))


def test_training_brings_pictures_near_the_views(
    trained: tuple[RadianceField, list[FieldTrainingProgress]], views: Views
) -> None:
    field, history = trained
    assert [step.done for step in history] == [250, 500, 750]
    found = evaluate_field.field_metrics(evaluate_field.render_views(field, views), views)
    assert found["psnr_db"] > evaluate_field.field_metrics(nothing(views), views)["psnr_db"] + 8.0
    # A pixel of these views is as large as a cell of the grid.
    assert found["silhouette_iou"] > 0.9


def test_the_reference_network_trains_too(box: TargetMesh, views: Views) -> None:
    field, _ = train_field.train(box, views, FieldTrainingOptions(steps=100, rays=64, kind="point"))
    found = evaluate_field.field_metrics(evaluate_field.render_views(field, views), views)
    assert found["psnr_db"] > evaluate_field.field_metrics(nothing(views), views)["psnr_db"] + 3.0
    assert found["silhouette_iou"] > 0.8


def test_a_training_that_was_interrupted_goes_on_to_the_same_field(
    trained: tuple[RadianceField, list[FieldTrainingProgress]], box: TargetMesh, views: Views, tmp_path: Path
) -> None:
    checkpoint = tmp_path / "checkpoint"
    seen: list[int] = []

    def note(step: FieldTrainingProgress) -> None:
        seen.append(step.done)
        if seen == [250]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_field.train(box, views, SHORT, checkpoint, note)
    resumed, _ = train_field.train(box, views, SHORT, checkpoint, note)
    assert seen == [250, 500, 750]
    whole = trained[0]
    assert isinstance(resumed, GridField)
    assert isinstance(whole, GridField)
    np.testing.assert_array_equal(resumed.node_row, whole.node_row)
    # The same program on the same numbers; a sum over threads may end in another order.
    np.testing.assert_allclose(resumed.occupancy, whole.occupancy, atol=1e-2)
    for a, b in zip(resumed.network, whole.network, strict=True):
        np.testing.assert_allclose(a[0], b[0], atol=1e-3)


def test_a_training_that_is_over_says_so_again(box: TargetMesh, views: Views, tmp_path: Path) -> None:
    recipe = FieldTrainingOptions(steps=120, rays=64, rows=2000)
    _, first = train_field.train(box, views, recipe, tmp_path / "checkpoint")
    assert [step.done for step in first] == [100]  # chunks of 50, never more than asked for
    _, again = train_field.train(box, views, recipe, tmp_path / "checkpoint")
    assert again == first
    made, remade = (train_field.model_card(box, views, recipe, history, "") for history in (first, again))
    assert made == remade
    # Another limit of time is no other training.
    limited = FieldTrainingOptions(steps=120, rays=64, rows=2000, limit_s=1e3)
    assert train_field.train(box, views, limited, tmp_path / "checkpoint")[1] == first


def test_training_ends_where_nothing_is_gained(box: TargetMesh, views: Views) -> None:
    recipe = FieldTrainingOptions(steps=5000, rays=64, rows=2000, patience=1, gain_db=1000.0)
    _, history = train_field.train(box, views, recipe)
    assert [step.done for step in history] == [250, 500]


def test_the_figures_of_a_perfect_picture_are_perfect(views: Views) -> None:
    found = evaluate_field.field_metrics(evaluate_field.RenderedViews(views.rgb, views.alpha), views)
    assert found["psnr_db"] == 100.0
    assert found["ssim"] == pytest.approx(1.0)
    assert found["silhouette_iou"] == found["box_iou_median"] == 1.0


def test_psnr_and_boxes_are_as_worked_by_hand() -> None:
    assert image_quality.psnr(np.full(10, 0.01)) == pytest.approx(20.0)
    alpha = np.zeros((8, 8), np.float32)
    alpha[2:5, 3:7] = 1.0
    alpha[2:5, 2] = 0.25
    np.testing.assert_allclose(image_quality.silhouette_box(alpha), [2.75, 2.0, 7.0, 5.0])
    assert image_quality.box_iou(np.array([0.0, 0.0, 2.0, 2.0]), np.array([1.0, 0.0, 3.0, 2.0])) == pytest.approx(1 / 3)
