"""`rpojax lincov`: what it refuses, and what it writes."""

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_linear_covariance import synthetic_linear_covariance

from rpojax.analysis.linear_covariance import linear_covariance, monte_carlo_agreement
from rpojax.cli import main
from rpojax.cli.commands.analysis import lincov


def call(*words: object) -> int:
    """Exit status of a command line."""
    return main.main([str(word) for word in words])


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--runs", 5), "--runs"),
        (("--runs", -20), "--runs"),
        (("--seed", -1), "--seed"),
        (("--members", 1), "--members"),
        (("--set", "camera.model='rendered'"), "camera.model"),
        (("--set", "effects.faults=true"), "effects.faults"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[object, ...], named: str
) -> None:
    assert call("lincov", "inspection", *words, "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert error.startswith("rpojax: error: ")
    assert named in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_files_figures_and_warnings_come_of_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    linear, sampled = synthetic_linear_covariance(scale=1.5)
    monkeypatch.setattr(linear_covariance, "propagate_covariance", lambda *_, **__: linear)
    monkeypatch.setattr(monte_carlo_agreement, "simulate_sample", lambda *_: sampled)
    words = ("lincov", "inspection", "--runs", 400, "--out", tmp_path / "out")
    assert call(*words, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "lincov.json").read_text())
    assert printed["settings"]["runs"] == 400
    assert {row["channel"] for row in printed["agreement"]} == {*monte_carlo_agreement.CHANNELS}
    assert any(warning.startswith("rho_H x: off by more than 15 %") for warning in printed["warnings"])
    with np.load(tmp_path / "out" / "lincov.npz") as arrays:
        assert arrays["covariance"].shape == (len(linear.time_s), 12, 12)
        np.testing.assert_array_equal(arrays["rho_H_sigma"], linear.sigma("rho_H"))
    for name in ("formation_error", "estimation_error", "delta_v", "error_budget"):
        assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert call(*words) == 2
    assert "--force" in capsys.readouterr().err
    lincov._show(printed, tmp_path)
    shown = capsys.readouterr().out
    assert "linear over sampled" in shown
    assert "warning: rho_H x" in shown
