"""Calibration of the detector's score: at its threshold one empty image in a hundred has a box."""

import numpy as np

from rpojax.training.detector.evaluation.evaluate_detector import detect_images
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, DetectorParams, with_shifted_score

EMPTY_SHARE = 0.01
"""Fraction of empty images whose best box is to reach the threshold."""
_LEAST_IMAGES = 100


def calibrate_score(params: DetectorParams, data: DetectionDataset) -> DetectorParams:
    """Parameters whose score reaches the threshold in a hundredth of the images of a data set that are empty.

    Scores move by the same log-odds, so their order stays. With fewer than a hundred empty images nothing moves.
    """
    empty = data.subset(np.array([i for i, boxes in enumerate(data.boxes) if len(boxes) == 0], int))
    if len(empty) < _LEAST_IMAGES:
        return params
    best = np.array([np.max(scores, initial=1e-6) for scores in detect_images(params, empty.images).scores])
    reached = float(np.quantile(best, 1.0 - EMPTY_SHARE))
    return with_shifted_score(params, _log_odds(SCORE_THRESHOLD) - _log_odds(reached))


def _log_odds(score: float) -> float:
    return float(np.log(score) - np.log1p(-score))
