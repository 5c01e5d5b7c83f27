"""The switch between batching over the last axis and `jax.vmap`."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.batching import batching_mode, vmap_last_axis
from rpojax.errors import BatchingError, Notice, RpojaxError

ROOT = Path(__file__).parents[2]


def test_batching_over_the_last_axis_is_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in (None, "", "last_axis"):
        monkeypatch.delenv(batching_mode.VARIABLE, raising=False)
        if value is not None:
            monkeypatch.setenv(batching_mode.VARIABLE, value)
        assert batching_mode.transform() is vmap_last_axis.vmap


@pytest.mark.parametrize("version", ["0.9.2", "0.13.0", "1.0.0.dev20270101"])
def test_runs_are_batched_by_jax_with_a_version_that_is_not_known(
    version: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(batching_mode.VARIABLE, raising=False)
    monkeypatch.setattr(jax, "__version__", version)
    with pytest.warns(Notice, match=rf"jax {version}: found a version other than 0\.10 to 0\.12, .* by jax\.vmap"):
        assert batching_mode.transform() is jax.vmap
    assert batching_mode.transform() is jax.vmap  # said once
    monkeypatch.setenv(batching_mode.VARIABLE, "last_axis")
    assert batching_mode.transform() is vmap_last_axis.vmap


@pytest.mark.parametrize("version", ["0.10.0", "0.11.1", "0.12.0.1"])
def test_known_versions(version: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(batching_mode.VARIABLE, raising=False)
    monkeypatch.setattr(jax, "__version__", version)
    assert batching_mode.transform() is vmap_last_axis.vmap


def test_the_environment_chooses_vmap_of_jax(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(batching_mode.VARIABLE, "jax")
    assert batching_mode.transform() is jax.vmap
    assert batching_mode.transform("last_axis") is vmap_last_axis.vmap


def test_an_unknown_mode_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(batching_mode.VARIABLE, "first_axis")
    with pytest.raises(RpojaxError, match="RPOJAX_BATCHING: found 'first_axis', expected one of last_axis, jax"):
        batching_mode.transform()


def test_vmap_of_jax_does_what_the_other_refuses(capfd: pytest.CaptureFixture[str]) -> None:
    def printing(x: Any) -> Any:
        jax.debug.print("{}", x)
        return x * 2.0

    values = np.arange(3.0)
    with pytest.raises(BatchingError):
        batching_mode.transform("last_axis")(printing, in_axes=-1, out_axes=-1)(values)
    doubled = batching_mode.transform("jax")(printing, in_axes=-1, out_axes=-1)(values)
    np.testing.assert_array_equal(doubled, jnp.asarray(values) * 2.0)
    jax.effects_barrier()
    assert len(capfd.readouterr().out.split()) == 3


def test_no_other_module_chooses_the_transform() -> None:
    """Otherwise the switch would not change everything."""
    users = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "rpojax").rglob("*.py")
        if "vmap_last_axis" in path.read_text(encoding="utf-8")
    ]
    assert sorted(users) == ["rpojax/batching/batching_mode.py"]
