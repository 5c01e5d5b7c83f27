"""Evaluation of the detector: average precision, pairs, false boxes, with intervals and by kind of image."""
