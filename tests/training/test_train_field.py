"""Training lowers the error, goes on after an interrupt, and ends in a field that judges well."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from rpojax.training import judge, train_field
from rpojax.training.raytrace import Views
from rpojax.training.target_mesh import TargetMesh
from rpojax.training.train_field import Recipe, Step

SHORT = Recipe(steps=250, rays=128, rows=3000)


@pytest.mark.parametrize("kind", ["grid", "point"])
def test_training_lowers_the_error_of_views_held_out(box: TargetMesh, views: Views, kind: str) -> None:
    recipe = dataclasses.replace(SHORT, kind=kind)
    field, history = train_field.train(box, views, recipe)
    untrained = judge.figures(judge.pictures(train_field.fresh(box, recipe), views), views)
    trained = judge.figures(judge.pictures(field, views), views)
    assert trained["psnr_db"] > untrained["psnr_db"] + 3.0
    assert history[-1].done == 250
    if kind == "grid":
        assert trained["silhouette_iou"] > 0.8  # 32 px views, 250 steps


def test_a_training_that_was_interrupted_goes_on_to_the_same_field(
    box: TargetMesh, views: Views, tmp_path: Path
) -> None:
    recipe = dataclasses.replace(SHORT, steps=500)
    whole, _ = train_field.train(box, views, recipe)

    checkpoint = tmp_path / "checkpoint"
    seen: list[int] = []

    def note(step: Step) -> None:
        seen.append(step.done)
        if step.done == 250 and len(seen) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_field.train(box, views, recipe, checkpoint, note)
    resumed, _ = train_field.train(box, views, recipe, checkpoint, note)
    assert seen == [250, 500]
    np.testing.assert_allclose(resumed.low, whole.low)
    for a, b in zip(resumed.network, whole.network, strict=True):
        np.testing.assert_allclose(a[0], b[0], atol=1e-3)


def test_the_figures_of_a_perfect_picture_are_perfect(views: Views) -> None:
    found = judge.figures(judge.Pictures(views.rgb, views.alpha), views)
    assert found["psnr_db"] == 100.0
    assert found["ssim"] == pytest.approx(1.0)
    assert found["silhouette_iou"] == found["box_iou_median"] == 1.0


def test_psnr_and_boxes_are_as_worked_by_hand() -> None:
    assert judge.psnr(np.full(10, 0.01)) == pytest.approx(20.0)
    alpha = np.zeros((8, 8), np.float32)
    alpha[2:5, 3:7] = 1.0
    alpha[2:5, 2] = 0.25
    np.testing.assert_allclose(judge.silhouette_box(alpha), [2.75, 2.0, 7.0, 5.0])
    assert judge.box_iou(np.array([0.0, 0.0, 2.0, 2.0]), np.array([1.0, 0.0, 3.0, 2.0])) == pytest.approx(1 / 3)
