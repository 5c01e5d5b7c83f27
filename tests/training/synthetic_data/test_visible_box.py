"""Visible box of a silhouette."""

import numpy as np

from rpojax.training.synthetic_data.image_sensor import ImageSensor
from rpojax.training.synthetic_data.visible_box import known_edges, visible_box


def bar_alpha(left: float, right: float) -> np.ndarray:
    """Alpha (16, 16) of a bar between two edges, rows 4 to 9."""
    pixel = np.arange(16)
    across = np.clip(np.minimum(pixel + 1, right) - np.maximum(pixel, left), 0.0, 1.0)
    return np.outer((pixel >= 4) & (pixel < 9), across)


def over(color: np.ndarray, background: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """A colour over a background."""
    return color * alpha[..., None] + background * (1.0 - alpha[..., None])


def test_edges_are_within_partly_covered_pixels() -> None:
    alpha = bar_alpha(3.25, 11.6)
    black = np.zeros((16, 16, 3))
    box = visible_box(over(np.full((16, 16, 3), 0.5), black, alpha), black, alpha)
    np.testing.assert_allclose(box, [3.25, 4.0, 11.6, 9.0])


def test_dark_part_is_outside_of_box_on_black_and_inside_on_bright_background() -> None:
    alpha = bar_alpha(3.0, 12.0)
    color = np.zeros((16, 16, 3))
    color[:, :7] = 0.5
    black, bright = np.zeros((16, 16, 3)), np.full((16, 16, 3), 0.6)
    np.testing.assert_allclose(visible_box(over(color, black, alpha), black, alpha), [3.0, 4.0, 7.0, 9.0])
    np.testing.assert_allclose(visible_box(over(0.0 * color, bright, alpha), bright, alpha), [3.0, 4.0, 12.0, 9.0])
    assert visible_box(over(0.0 * color, black, alpha), black, alpha) is None


def test_signal_below_noise_is_not_visible() -> None:
    alpha = bar_alpha(3.0, 12.0)
    black = np.zeros((16, 16, 3))
    faint = over(np.full((16, 16, 3), 0.006), black, alpha)
    assert visible_box(faint, black, alpha, ImageSensor(1e5, 10.0)) is not None
    assert visible_box(faint, black, alpha, ImageSensor(1e3, 10.0)) is None


def test_edges_without_contrast_are_not_known() -> None:
    alpha = bar_alpha(3.0, 12.0)
    hidden = np.full((16, 16, 3), 0.05)
    color = np.full((16, 16, 3), 0.5)
    color[:, 8:] = 0.054  # its right part is hardly brighter than what it hides
    image, sensor = over(color, hidden, alpha), ImageSensor(1e7, 1.0)
    box = np.array([3.0, 4.0, 12.0, 9.0])
    np.testing.assert_array_equal(known_edges(image, hidden, alpha, box, sensor), [True, True, False, True])
    # Before clutter stronger than the contrast none is known.
    clutter = np.random.default_rng(0).uniform(0.3, 0.9, (16, 16, 1)) * np.ones(3)
    assert not known_edges(over(clutter + 0.05, clutter, alpha), clutter, alpha, box, sensor).any()
