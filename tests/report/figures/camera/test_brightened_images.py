"""Camera images developed for the eye."""

import numpy as np

from rpojax.report.figures.brightened_images import developed


def dark_image(level: int) -> np.ndarray:
    """Noise of a few counts with a target of 13 x 13 pixels, orange, in the middle."""
    image = np.random.default_rng(2).integers(0, 4, (128, 128, 3)).astype(np.uint8)
    image[58:71, 58:71] = (level, level // 2, level // 4)
    return image


def test_a_dark_target_gets_bright_and_keeps_its_colour_and_the_sky_stays_dark() -> None:
    shown = developed(dark_image(60))
    assert shown.dtype == np.uint8
    red, green, blue = shown[64, 64].astype(float)
    assert 150 < red < 220
    assert abs(green / red - 0.5) < 0.03
    assert abs(blue / red - 0.25) < 0.03
    assert shown[:40].mean() < 4.0


def test_bright_images_and_those_of_the_earth_stay_as_they_are() -> None:
    bright = dark_image(230)
    assert developed(bright) is bright
    earth = np.full((64, 64, 3), 60, np.uint8)
    assert developed(earth) is earth
    black = np.zeros((64, 64, 3), np.uint8)
    assert developed(black) is black
