"""Structure at the frame's edge, and reflections in a window."""

import numpy as np

from rpojax.training.synthetic_data.scenery.backdrops import add_reflections, add_structure

SIZE = 64


def test_structure_lies_at_one_edge_of_the_frame() -> None:
    image = np.full((SIZE, SIZE, 3), 0.2, np.float32)
    touched = set()
    for seed in range(40):
        changed = np.abs(add_structure(np.random.default_rng(seed), image) - image).max(axis=2) > 1e-3
        # Blur reaches a few pixels beyond the deepest structure.
        assert not changed[26:-26, 26:-26].any()
        touched |= {name for name, side in _sides(changed).items() if side.mean() > 0.5}
    assert touched == {"left", "top", "right", "bottom"}


def _sides(values: np.ndarray) -> dict[str, np.ndarray]:
    return {"left": values[:, 0], "top": values[0], "right": values[:, -1], "bottom": values[-1]}


def test_reflections_add_light_and_have_no_sharp_edge() -> None:
    image = np.zeros((SIZE, SIZE, 3), np.float32)
    brightest = 0.0
    for seed in range(20):
        added = add_reflections(np.random.default_rng(seed), image)
        assert added.min() >= 0.0
        assert np.abs(np.diff(added, axis=0)).max() <= 0.6 * max(float(added.max()), 1e-9)
        brightest = max(brightest, float(added.max()))
    assert 0.01 < brightest < 0.5
