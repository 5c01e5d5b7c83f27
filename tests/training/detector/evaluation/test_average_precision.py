"""Average precision against pycocotools and a worked case."""

import contextlib
import io

import numpy as np
import pytest

from rpojax.training.detector.average_precision import average_precisions, match_detections

Boxes = list[np.ndarray]
MIN_SIDE_PX = 16.0


def scenes(seed: int, count: int = 40) -> tuple[Boxes, list[np.ndarray], Boxes]:
    """Random found boxes with scores, and true boxes: with misses, duplicates and false boxes."""
    rng = np.random.default_rng(seed)
    found, scores, truth = [], [], []
    for _ in range(count):
        corner = rng.uniform(0.0, 80.0, (int(rng.integers(0, 4)), 2))
        real = np.hstack([corner, corner + rng.uniform(6.0, 45.0, corner.shape)])
        again = np.repeat(real, rng.integers(0, 3, len(real)), axis=0)
        moved = again + rng.normal(scale=2.0, size=again.shape)
        extra = rng.uniform(0.0, 60.0, (int(rng.integers(0, 3)), 2))
        boxes = np.vstack([moved, np.hstack([extra, extra + rng.uniform(6.0, 40.0, extra.shape)])])
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1.0)
        found.append(boxes)
        scores.append(rng.uniform(size=len(boxes)))
        truth.append(real)
    return found, scores, truth


def long_sides(boxes: np.ndarray) -> np.ndarray:
    """Longer side of boxes (n, 4)."""
    return (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)


def by_pycocotools(found: Boxes, scores: list[np.ndarray], truth: Boxes, min_side_px: float) -> np.ndarray:
    """Average precision at the ten thresholds of COCO, with areas that encode the range of long sides."""
    coco = pytest.importorskip("pycocotools.coco")
    evaluation = pytest.importorskip("pycocotools.cocoeval")

    def entries(images: Boxes) -> list[dict]:
        listed = []
        for index, boxes in enumerate(images):
            for box, side in zip(boxes, long_sides(boxes), strict=True):
                xywh = [*box[:2], *(box[2:] - box[:2])]
                listed.append({"image_id": index, "category_id": 1, "bbox": xywh, "area": side**2, "iscrowd": 0})
        return [{**entry, "id": number + 1} for number, entry in enumerate(listed)]

    with contextlib.redirect_stdout(io.StringIO()):
        real = coco.COCO()
        real.dataset = {
            "images": [{"id": index} for index in range(len(truth))],
            "categories": [{"id": 1}],
            "annotations": entries(truth),
        }
        real.createIndex()
        detections = coco.COCO()
        scored = [
            {**entry, "score": score} for entry, score in zip(entries(found), np.concatenate(scores), strict=True)
        ]
        detections.dataset = {**real.dataset, "annotations": scored}
        detections.createIndex()
        coco_evaluation = evaluation.COCOeval(real, detections, "bbox")
        coco_evaluation.params.areaRng = [[min_side_px**2, 1e10]]
        coco_evaluation.params.areaRngLbl = ["all"]
        coco_evaluation.evaluate()
        coco_evaluation.accumulate()
    return coco_evaluation.eval["precision"][:, :, 0, 0, -1].mean(axis=1)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("min_side_px", [0.0, MIN_SIDE_PX])
def test_average_precision_matches_pycocotools(seed: int, min_side_px: float) -> None:
    found, scores, truth = scenes(seed)
    ignored_truth = [long_sides(boxes) < min_side_px for boxes in truth]
    ignored_boxes = [long_sides(boxes) < min_side_px for boxes in found]
    expected = by_pycocotools(found, scores, truth, min_side_px)
    assert 0.05 < expected.mean() < 0.95
    np.testing.assert_allclose(
        average_precisions(match_detections(found, scores, truth, ignored_truth, ignored_boxes)), expected, atol=1e-9
    )


def test_average_precision_of_worked_case() -> None:
    truth = [np.array([[0.0, 0.0, 10.0, 10.0]]), np.array([[0.0, 0.0, 10.0, 10.0]])]
    found = [np.array([[0.0, 0.0, 10.0, 10.0]]), np.array([[20.0, 20.0, 30.0, 30.0], [0.0, 0.0, 10.0, 8.0]])]
    scores = [np.array([0.9]), np.array([0.8, 0.7])]
    # Precision 1 up to recall 0.5 (51 of 101 recalls), then 2/3; the IoU of the last box is 0.8.
    expected = (51 + 50 * 2 / 3) / 101
    precision = average_precisions(match_detections(found, scores, truth, thresholds=np.array([0.5, 0.85])))
    np.testing.assert_allclose(precision, [expected, 51 / 101])


def test_without_true_boxes_precision_is_nan() -> None:
    assert np.isnan(average_precisions(match_detections([np.zeros((0, 4))], [np.zeros(0)], [np.zeros((0, 4))]))).all()
