"""Camera images developed for the eye: what a detector finds in a few counts is black on a screen."""

from typing import Final

import numpy as np

_DARK_SKY: Final = 0.08
"""Median brightness, of 1, above which something else than the sky fills the frame, which is bright enough."""
_NOISE_PERCENTILE: Final = 95.0
"""Pixels up to it are sky and noise, which stay dark: the target takes a hundredth of the frame."""
_BRIGHT_PERCENTILE: Final = 99.5
_WANTED: Final = 0.75
"""Brightness that the bright pixels get, of 1."""
_STRONGEST: Final = 30.0
"""Largest factor of the curve: beyond it noise would be all that one sees."""
_STEPS: Final = 24


def developed(image: np.ndarray) -> np.ndarray:
    """Image (h, w, 3), uint8, in which a target before a dark sky is bright; others stay as they are.

    The brightness of a pixel goes through asinh(k x) / asinh(k) above the noise, its colour stays (Lupton et al., PASP
    116, 2004).
    """
    shares = image.astype(np.float64) / 255.0
    brightness = shares.max(axis=2)
    noise, bright = np.percentile(brightness, (_NOISE_PERCENTILE, _BRIGHT_PERCENTILE))
    if np.median(brightness) > _DARK_SKY or bright >= _WANTED or bright <= 0.0:
        return image
    black = min(float(noise), 0.3 * float(bright))
    above = np.clip(brightness - black, 0.0, None) / (1.0 - black)
    factor = _factor((float(bright) - black) / (1.0 - black))
    wanted = np.arcsinh(factor * above) / np.arcsinh(factor)
    ratio = np.divide(wanted, brightness, out=np.zeros_like(wanted), where=brightness > 0.0)
    # What the curve would darken, the sky and its noise, stays as it is.
    return np.round(255.0 * np.clip(shares * np.maximum(ratio, 1.0)[..., None], 0.0, 1.0)).astype(np.uint8)


def _factor(bright: float) -> float:
    """Factor of the curve that takes a brightness to the wanted one, by bisection; at most the strongest."""
    low, high = 1e-3, _STRONGEST
    for _ in range(_STEPS):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if np.arcsinh(middle * bright) < _WANTED * np.arcsinh(middle) else (low, middle)
    return float(high)
