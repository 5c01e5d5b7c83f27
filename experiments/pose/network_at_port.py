"""Landmarks that the packaged network finds 1.5 m before the docking port, through the wide lens of final_approach:

python experiments/pose/network_at_port.py --out DIR [--views 60]

The camera is on the port's axis with 3 deg of error (1 sigma per axis), with any roll, the target near the middle
of the frame. The exit status is 1 if fewer than nine tenths of the pictures have eight landmarks within 3 px.
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import jax
import numpy as np

from rpojax.training.pose import evaluate_landmarks
from rpojax.training.pose.held_back_pictures import held_back_pictures
from rpojax.training.pose.view_sampling import (
    HELD_OUT_STREAM,
    SUNS,
    WIDE_DEG,
    LandmarkView,
    LandmarkViewSampling,
    camera_axes,
)
from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.training.synthetic_data.random_views import unit_vectors
from rpojax.training.synthetic_data.scenery.earth_views import load_earth_textures
from rpojax.vision.landmark_network.network_file import load_network
from rpojax.vision.surface.landmark_file import load_landmarks

_RANGE_M, _CONE_DEG, _OFFSET, _LAMP_M, _PHASE_DEG = 1.5, 3.0, 0.02, 0.05, 110.0
_SHARE = 0.9


def view_at_port(sampling: LandmarkViewSampling, index: int, port_axis: np.ndarray | None) -> LandmarkView:
    """A view along the axis of the port."""
    assert port_axis is not None
    rng = np.random.default_rng([sampling.stream, sampling.seed, index, 9])
    away = port_axis + np.tan(np.radians(_CONE_DEG)) * rng.normal(size=3)
    away /= np.linalg.norm(away)
    boresight = np.array([*(_OFFSET * rng.normal(size=2)), 1.0])
    rotation = camera_axes(rng, -away, boresight / np.linalg.norm(boresight))
    suns: list[np.ndarray] = []
    while len(suns) < SUNS:
        suns += [sun for sun in unit_vectors(rng, 1) if sun @ away > np.cos(np.radians(_PHASE_DEG))]
    position = _RANGE_M * away
    lamp = position + _LAMP_M * unit_vectors(rng, 1)[0]
    return LandmarkView(rotation, position, _RANGE_M, WIDE_DEG, np.stack(suns), lamp)


def main() -> int:
    """Prints the figures; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder for the traced views")
    parser.add_argument("--views", type=int, default=60)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    landmarks, _ = load_landmarks()
    sampling = LandmarkViewSampling(asked.views, 0, HELD_OUT_STREAM, (_RANGE_M, 1.01 * _RANGE_M))
    pictures = held_back_pictures(
        packaged_target(), landmarks, load_earth_textures(held_out=True), sampling, asked.out, draw=view_at_port
    )
    boxes = evaluate_landmarks.jittered_boxes(pictures, 0)
    results = evaluate_landmarks.results(load_network(landmarks)[0], landmarks, pictures, boxes)
    figures = evaluate_landmarks.summary([dataclasses.replace(each, before_port=True) for each in results])
    visible = [int(picture.visible.sum()) for picture in pictures]
    print(json.dumps({"landmarks_in_sight": [min(visible), float(np.median(visible))], **figures}, indent=1))
    return int(figures["eight_landmarks_right"] < _SHARE)


if __name__ == "__main__":
    sys.exit(main())
