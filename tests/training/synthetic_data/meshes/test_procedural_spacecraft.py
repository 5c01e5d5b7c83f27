"""Random spacecraft."""

import numpy as np

from rpojax.training.synthetic_data.meshes import procedural_spacecraft


def test_spacecraft_are_of_plausible_size_and_distinct() -> None:
    meshes = [procedural_spacecraft.random_spacecraft([0, 0, index]) for index in range(40)]
    families = {mesh.name.split()[0] for mesh in meshes}
    assert len(families) >= 8
    for mesh in meshes:
        span = mesh.bounds[1] - mesh.bounds[0]
        assert np.isfinite(mesh.vertices).all()
        assert 0.1 <= span.max() <= 15.0
        np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0.0, atol=1e-9)
    again = procedural_spacecraft.random_spacecraft([0, 0, 7])
    np.testing.assert_array_equal(again.vertices, meshes[7].vertices)
    assert len({mesh.vertices.tobytes() for mesh in meshes}) == 40
