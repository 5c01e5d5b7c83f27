"""Training of the landmark network, with interruption."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.training.pose.landmark_views import LandmarkViews
from rpojax.training.pose.train_landmarks import (
    LandmarkTrainingOptions,
    LandmarkTrainingProgress,
    judged_count,
    train_landmark_network,
)
from rpojax.vision.landmark_network.network import initialize

_OPTIONS = LandmarkTrainingOptions(epochs=3, batch=4, rate=0.1)


def test_an_interrupted_training_continues_to_the_same_weights(
    spotted_views: LandmarkViews, black_backdrops: np.ndarray, tmp_path: Path
) -> None:
    start = initialize(jax.random.key(0), spotted_views.places.shape[1])
    whole, history = train_landmark_network(spotted_views, black_backdrops, _OPTIONS, start)
    assert [step.done for step in history] == [2, 4, 6]
    assert judged_count(len(spotted_views)) == 4
    checkpoint, reported = tmp_path / "checkpoint", []

    def report(step: LandmarkTrainingProgress) -> None:
        reported.append(step.done)
        if len(reported) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_landmark_network(spotted_views, black_backdrops, _OPTIONS, start, checkpoint, report)
    resumed, history = train_landmark_network(spotted_views, black_backdrops, _OPTIONS, start, checkpoint, report)
    assert reported == [2, 4, 6]
    assert [step.done for step in history] == [2, 4, 6]
    for a, b, first in zip(*(jax.tree.leaves(each) for each in (resumed, whole, start)), strict=True):
        # The order of sums over threads is not fixed.
        np.testing.assert_allclose(a, b, atol=1e-3)
        assert a.shape == first.shape
    moved = [np.abs(a - b).max() for a, b in zip(jax.tree.leaves(whole), jax.tree.leaves(start), strict=True)]
    assert np.median(moved) > 2e-3  # so that equality says something
    # A checkpoint of another training is not continued.
    other = dataclasses.replace(_OPTIONS, seed=1, epochs=1)
    assert [s.done for s in train_landmark_network(spotted_views, black_backdrops, other, start, checkpoint)[1]] == [2]


@pytest.mark.slow
def test_a_training_learns_to_find_spots_by_their_place(
    spotted_views: LandmarkViews, black_backdrops: np.ndarray
) -> None:
    """All views are one view, so that each spot is told by where the others are."""
    same = np.zeros(len(spotted_views), int)
    views = dataclasses.replace(
        spotted_views,
        **{field.name: getattr(spotted_views, field.name)[same] for field in dataclasses.fields(spotted_views)},
    )
    start = initialize(jax.random.key(0), views.places.shape[1])
    options = LandmarkTrainingOptions(epochs=150, batch=8)
    _, history = train_landmark_network(views, black_backdrops, options, start)
    assert history[0].accuracy["median_px"] > 8.0
    assert history[-1].accuracy["median_px"] < 2.0
