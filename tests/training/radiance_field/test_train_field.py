"""Training of a field: error, checkpoints and stopping."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rpojax.training.radiance_field import evaluate_field, train_field
from rpojax.training.radiance_field.train_field import FieldTrainingOptions, FieldTrainingProgress
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.radiance_field.grid_field import GridField

SHORT = FieldTrainingOptions(steps=350, rays=256, rows=8000)
SMALL = FieldTrainingOptions(steps=120, rays=16, rows=500)


def empty_views(views: Views) -> evaluate_field.RenderedViews:
    """Black images, as of an empty field."""
    return evaluate_field.RenderedViews(np.zeros_like(views.sunlit), np.zeros_like(views.alpha))


def test_training_reduces_image_error(box: TargetMesh, views: Views) -> None:
    field, history = train_field.train(box, views, SHORT)
    assert [step.done for step in history] == [250, 350]
    found = evaluate_field.field_metrics(evaluate_field.render_views(field, views), views)
    assert found["psnr_db"] > evaluate_field.field_metrics(empty_views(views), views)["psnr_db"] + 8.0
    # A pixel of these views is as large as a cell of the grid.
    assert found["silhouette_iou"] > 0.9


def test_nerf_trains(box: TargetMesh, views: Views) -> None:
    field, _ = train_field.train(box, views, FieldTrainingOptions(steps=100, rays=64, kind="point"))
    found = evaluate_field.field_metrics(evaluate_field.render_views(field, views), views)
    assert found["psnr_db"] > evaluate_field.field_metrics(empty_views(views), views)["psnr_db"] + 3.0
    assert found["silhouette_iou"] > 0.8


def test_interrupted_training_continues_to_same_field(box: TargetMesh, views: Views, tmp_path: Path) -> None:
    options, checkpoint = replace(SMALL, steps=350), tmp_path / "checkpoint"
    reported: list[int] = []

    def report(step: FieldTrainingProgress) -> None:
        reported.append(step.done)
        if reported == [250]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_field.train(box, views, options, checkpoint, report)
    resumed, _ = train_field.train(box, views, options, checkpoint, report)
    assert reported == [250, 350]
    whole, _ = train_field.train(box, views, options)
    assert isinstance(resumed, GridField)
    assert isinstance(whole, GridField)
    np.testing.assert_array_equal(resumed.node_row, whole.node_row)
    # The order of sums over threads is not fixed.
    np.testing.assert_allclose(resumed.occupancy, whole.occupancy, atol=1e-2)
    for a, b in zip(resumed.network, whole.network, strict=True):
        np.testing.assert_allclose(a[0], b[0], atol=1e-3)


def test_finished_training_returns_its_result(box: TargetMesh, views: Views, tmp_path: Path) -> None:
    _, first = train_field.train(box, views, SMALL, tmp_path / "checkpoint")
    assert [step.done for step in first] == [100]  # whole chunks of 50
    _, again = train_field.train(box, views, SMALL, tmp_path / "checkpoint")
    assert again == first
    made, remade = (train_field.model_card(box, views, SMALL, history, "") for history in (first, again))
    assert made == remade
    # The time limit is not part of the key of the checkpoint.
    limited = replace(SMALL, limit_s=1e3)
    assert train_field.train(box, views, limited, tmp_path / "checkpoint")[1] == first


def test_training_ends_without_gain(box: TargetMesh, views: Views) -> None:
    options = replace(SMALL, steps=5000, patience=1, gain_db=1000.0)
    _, history = train_field.train(box, views, options)
    assert [step.done for step in history] == [250, 500]
