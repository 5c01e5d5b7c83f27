"""A run to be shown comes from its kept history or is flown again, and says so."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from folders import new_campaign

from rpojax.campaign import single
from rpojax.campaign.store import Campaign
from rpojax.errors import RpojaxError
from rpojax.interop import flight as flights
from rpojax.interop import rerun_scene
from rpojax.interop.flight import Flight
from rpojax.simulation import scenario

SEED, RUN = 1, 4


def folder(path: Path, words: tuple[str, ...], history: dict[str, np.ndarray] | None) -> Campaign:
    """A campaign of eight runs that holds at most one history."""
    kept = [] if history is None else [RUN]
    made = new_campaign(path / "runs", scenario.load("inspection", words), SEED, 8, 0, 1, kept)
    if history is not None:
        made.write_history(RUN, history)
    return made


@pytest.fixture
def again(made_up: Flight, monkeypatch: pytest.MonkeyPatch) -> Flight:
    """The made-up run takes the place of a flight."""
    own = {"R_HN": made_up.R_HN, "relative_covariance_H": made_up.covariance_H}
    monkeypatch.setattr(flights, "fly", lambda *_: ({**made_up.channels, **own}, made_up.chosen))
    return made_up


def single_precision(channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {
        name: values.astype(np.float32) if values.dtype == float and name != "time_s" else values
        for name, values in channels.items()
    }


def test_a_history_with_attitudes_is_shown_as_it_is(
    made_up: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its networks would take their time to load, and are not looked at.
    monkeypatch.setattr(single, "dispersed", lambda *_: (None, made_up.chosen, None))
    history = single_precision(made_up.channels | {"window_px": np.tile([0.0, 0.0, 128.0], (made_up.ticks, 1))})
    found = flights.flight_of(folder(tmp_path, ("camera.model=rendered",), history), RUN)
    assert (found.again, found.moved_m, found.ticks) == (False, None, made_up.ticks)
    np.testing.assert_array_equal(found.channels["rho_H"], history["rho_H"])
    # The orbit's plane comes from a radius of 7000 km in single precision.
    turn = found.R_HN @ made_up.R_HN.transpose(0, 2, 1)
    assert np.abs(turn - np.eye(3)).max() < 1e-4
    half, _ = rerun_scene.ellipsoids(found.covariance_H)
    np.testing.assert_allclose(np.sort(half), np.sort(3.0 * history["relative_sigma_H"]), rtol=1e-6)


def test_a_run_without_attitudes_is_flown_again_and_compared(again: Flight, tmp_path: Path) -> None:
    kept = again.channels | {"rho_H": again.channels["rho_H"] + [0.003, 0.0, 0.004]}
    poor = {name: values for name, values in kept.items() if name not in ("q_BN", "q_TN", "r_TN_N", "r_ST_N")}
    found = flights.flight_of(folder(tmp_path, (), single_precision(poor)), RUN)
    assert found.again
    assert found.moved_m == pytest.approx(0.005, rel=1e-2)
    np.testing.assert_array_equal(found.channels["rho_H"], again.channels["rho_H"])
    np.testing.assert_array_equal(found.covariance_H, again.covariance_H)
    assert (found.population.first_run, found.population.runs) == (0, 8)


def test_a_run_without_a_history_has_nothing_to_be_compared_with(again: Flight, tmp_path: Path) -> None:
    assert flights.flight_of(folder(tmp_path, (), None), RUN).moved_m is None


def test_a_run_ends_where_it_failed(again: Flight, tmp_path: Path) -> None:
    running = np.arange(again.ticks) < 33
    again.channels["running"] = running
    found = flights.flight_of(folder(tmp_path, (), None), RUN)
    assert {len(values) for name, values in found.channels.items() if name != "rho_desired_H"} == {33}
    assert (found.ticks, len(found.R_HN), len(found.covariance_H)) == (33, 33, 33)
    running[:] = False
    with pytest.raises(RpojaxError, match="run 4: found no tick before it failed"):
        flights.flight_of(folder(tmp_path / "other", (), None), RUN)


def test_a_run_that_there_is_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RpojaxError, match="--run-id: found 8, expected a run of this campaign, 0 to 7"):
        flights.flight_of(folder(tmp_path, (), None), 8)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"stages": {"wheel_torque": {}}}, r"run 4: found replaced stages \['wheel_torque'\]"),
        ({"scenario_hash": "0" * 64}, "imaging: found other trained files"),
    ],
)
def test_another_run_than_the_campaigns_is_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict, said: str
) -> None:
    found = folder(tmp_path, (), None)
    monkeypatch.setattr(Campaign, "info", found.info | change)
    with pytest.raises(RpojaxError, match=said):
        flights.flight_of(found, RUN)


@pytest.mark.slow
def test_a_flight_is_the_run_of_the_campaign_with_its_poses() -> None:
    file = scenario.load("inspection", ("duration_s=250",))
    told: list[tuple[int, int]] = []
    flown, chosen = flights.fly(file, SEED, RUN, count=lambda *progress: told.append(progress))
    alone = single.simulate(file, SEED, RUN)
    assert told == [(200, 250), (250, 250)]
    assert set(flown) == {*alone, "R_HN", "relative_covariance_H", "r_TN_N", "r_ST_N", "q_TN", "q_BN"}
    for name in ("rho_H", "relative_error_H", "box_px", "mode", "delta_v_m_s"):
        np.testing.assert_allclose(flown[name], alone[name], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", flown["R_HN"], flown["r_ST_N"]), flown["rho_H"], atol=1e-4)
    sigma = np.sqrt(np.einsum("tii->ti", flown["relative_covariance_H"]))
    np.testing.assert_allclose(sigma, flown["relative_sigma_H"], rtol=1e-5)
    assert float(chosen.plant.servicer.mass) == pytest.approx(alone["mass_kg"][0], rel=1e-6)


def test_the_verb_tells_what_it_wrote(again: Flight, tmp_path: Path, export: Callable[..., tuple[int, str]]) -> None:
    made, out = folder(tmp_path, (), None), tmp_path / "new" / "run.rrd"
    status, said = export(made.directory, "--run-id", RUN, "--out", out, "--json")
    assert status == 0
    assert json.loads(said) == {
        "file": str(out),
        "ticks": again.ticks,
        "pictures": 0,
        "size_bytes": out.stat().st_size,
        "flown_again": True,
        "moved_m": None,
    }
    assert export(made.directory, "--run-id", RUN, "--out", out) == (
        2,
        f"rpojax: error: {out}: exists already; --force replaces it\n",
    )
    assert export(made.directory, "--run-id", RUN, "--out", out, "--force") == (0, f"{out}\n")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--run-id", "4", "--out", "run.mp4"], "run.mp4: found suffix '.mp4', expected .rrd"),
        (["--run-id", "4", "--out", "r.rrd", "--every", "0"], "--every: found 0, expected at least 1"),
        (["--run-id", "9", "--out", "r.rrd"], "--run-id: found 9, expected a run of this campaign, 0 to 7"),
    ],
)
def test_the_verb_refuses_in_one_line(
    tmp_path: Path, export: Callable[..., tuple[int, str]], words: list[str], said: str
) -> None:
    assert export(folder(tmp_path, (), None).directory, *words) == (2, f"rpojax: error: {said}\n")


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """The verb in this process: exit status, and what it said on stdout or, refused, on stderr."""
    from rpojax import cli

    def run(*words: object) -> tuple[int, str]:
        capsys.readouterr()
        status = cli.main(["export-rrd", *map(str, words)])
        said = capsys.readouterr()
        return status, said.err if status else said.out

    return run
