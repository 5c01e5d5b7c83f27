"""Facets and tables of an earlier process are those that this one would make; damaged files are made again."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.vision.surface import surface_cache
from tests import surface_meshes


def test_kept_surfaces_are_equal_and_damage_is_repaired(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    triangles = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 0.6, 0.4))
    facets, table = surface_cache.facets_and_table(triangles, 0.2)
    (file,) = (tmp_path / "rpojax_surfaces").iterdir()

    def check() -> None:
        again, same = surface_cache.facets_and_table(triangles, 0.2)
        np.testing.assert_array_equal(same, table)
        for name, values in facets.arrays().items():
            np.testing.assert_array_equal(again.arrays()[name], values, strict=True)

    with monkeypatch.context() as context:
        context.setattr(surface_cache, "make_facets", None)
        check()
    file.write_bytes(file.read_bytes()[:1000])
    check()
    other, _ = surface_cache.facets_and_table(triangles, 0.1)
    assert len(other.areas) > len(facets.areas)
    assert len(list((tmp_path / "rpojax_surfaces").iterdir())) == 2


def test_nothing_is_kept_without_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.chdir(tmp_path)
    surface_cache.facets_and_table(surface_meshes.box((0.0, 0.0, 0.0), (1.0, 0.6, 0.4)), 0.3)
    assert list(tmp_path.iterdir()) == []
