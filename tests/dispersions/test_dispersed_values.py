"""Each kind of dispersion has the distribution it declares, and a draw depends on nothing but run and key."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import quaternion, random_streams
from rpojax.dispersions import dispersed_values
from rpojax.errors import ScenarioError
from rpojax.physics import equipment_faults
from rpojax.scenario import dispersion_kinds, params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings

RUNS = 4000
FIVE_SIGMA = 5.0 / np.sqrt(RUNS)
"""A mean of standard numbers leaves this with a chance below 1e-6; the seed is fixed, so a test cannot flicker."""
LAST_DIGITS = 1e-13
"""Compilers may fuse a multiplication with an addition in one program and not in another."""

NOMINAL_ATTITUDE = [0.5, -0.5, -0.5, -0.5]


def dispersed(mission: ScenarioFile, *entries: Any) -> ScenarioFile:
    """`mission` with other dispersions, checked."""
    tables = mission.model_dump()
    return scenario_loader.validate(tables | {"dispersions": [entry.model_dump() for entry in entries]})


def draw(file: ScenarioFile, run_ids: Sequence[int] | np.ndarray, seed: int = 3) -> dict[str, np.ndarray]:
    """Values of the given runs."""

    def one(run_id: jax.Array) -> dispersed_values.Values:
        return dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(seed), run_id), {})

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(jnp.asarray(run_ids, dtype=jnp.int32)))


ONE_OF_EACH = (
    dispersion_kinds.Normal(key="initial.relative_position_m", kind="normal", sigma=[1.0, 2.0, 0.0]),
    dispersion_kinds.TruncatedNormal(key="servicer.mass_kg", kind="truncated_normal", sigma=2.0, limit_sigmas=1.5),
    dispersion_kinds.Uniform(key="orbit.true_anomaly_deg", kind="uniform", low=-30.0, high=90.0),
    dispersion_kinds.LogNormal(key="gps.noise_m", kind="log_normal", sigma=0.4),
    dispersion_kinds.Choice(key="target.tumble_rate_deg_s", kind="choice", values=[0.0, 1.0, 5.0]),
    dispersion_kinds.RandomDirection(key="target.tumble_axis", kind="direction"),
    dispersion_kinds.RandomAttitude(key="target.attitude", kind="attitude"),
    dispersion_kinds.SmallRotation(key="camera.mounting", kind="small_rotation", sigma_deg=[1.0, 2.0, 3.0]),
)


@pytest.fixture(scope="module")
def drawn(mission: ScenarioFile) -> dict[str, np.ndarray]:
    """Many runs with one dispersion of each kind."""
    return draw(dispersed(mission, *ONE_OF_EACH), np.arange(RUNS))


def test_normal_has_nominal_mean_and_its_sigma_per_component(drawn: dict[str, np.ndarray]) -> None:
    error = drawn["initial.relative_position_m"] - np.array([0.0, -50.0, 0.0])
    assert np.all(np.abs(error[:, :2].mean(axis=0) / [1.0, 2.0]) < FIVE_SIGMA)
    np.testing.assert_allclose(error[:, :2].std(axis=0), [1.0, 2.0], rtol=FIVE_SIGMA)
    assert np.all(error[:, 2] == 0.0)
    assert abs(np.corrcoef(error[:, 0], error[:, 1])[0, 1]) < FIVE_SIGMA


def test_truncated_normal_stays_inside_its_limit_and_has_the_variance_of_the_cut_bell(
    drawn: dict[str, np.ndarray],
) -> None:
    share = (drawn["servicer.mass_kg"] - 30.0) / 2.0
    density = np.exp(-0.5 * 1.5**2) / np.sqrt(2.0 * np.pi)
    inside = 0.8663855974622838  # of a normal number within 1.5 sigma
    assert np.abs(share).max() <= 1.5
    assert np.abs(share).max() > 1.45
    assert abs(share.mean()) < FIVE_SIGMA
    np.testing.assert_allclose(share.var(), 1.0 - 2.0 * 1.5 * density / inside, rtol=2.0 * FIVE_SIGMA)


def test_uniform_fills_its_interval_evenly(drawn: dict[str, np.ndarray]) -> None:
    share = np.sort((drawn["orbit.true_anomaly_deg"] + 30.0) / 120.0)
    assert share[0] >= 0.0
    assert share[-1] < 1.0
    largest_gap = np.abs(share - np.arange(RUNS) / RUNS).max()
    assert largest_gap < 2.3 / np.sqrt(RUNS)  # Kolmogorov's bound for a chance of 1e-4


def test_log_normal_has_the_nominal_median_and_its_sigma_in_the_logarithm(drawn: dict[str, np.ndarray]) -> None:
    logarithm = np.log(drawn["gps.noise_m"] / 2.0) / 0.4
    assert abs(logarithm.mean()) < FIVE_SIGMA
    np.testing.assert_allclose(logarithm.std(), 1.0, rtol=FIVE_SIGMA)


def test_choice_takes_every_value_equally_often(drawn: dict[str, np.ndarray]) -> None:
    values, counts = np.unique(drawn["target.tumble_rate_deg_s"], return_counts=True)
    np.testing.assert_array_equal(values, [0.0, 1.0, 5.0])
    np.testing.assert_allclose(counts / RUNS, 1.0 / 3.0, atol=FIVE_SIGMA)


def test_a_kind_of_fault_drawn_by_name_strikes_the_equipment_of_that_name(mission: ScenarioFile) -> None:
    names = ["thruster_weak", "gps_outage", "camera_blackout"]
    file = dispersed(mission, dispersion_kinds.Choice(key="fault.kind", kind="choice", values=names))
    drawn = draw(file, np.arange(RUNS))["fault.kind"]
    codes = [equipment_faults.KINDS.index(name) for name in names]
    shares = [np.mean(drawn == code) for code in codes]
    np.testing.assert_allclose(shares, 1 / 3, atol=FIVE_SIGMA * np.sqrt(2.0) / 3.0)
    assert set(drawn) == set(codes)
    settings = static_settings(file)
    nominal = params.build_params(file.model_dump(), settings.width_px, settings.height_px)
    for code, name in zip(codes, names, strict=True):
        plant = dispersed_values.apply_to_params(nominal, {"fault.kind": jnp.float64(code)}).plant
        health = equipment_faults.health_at(plant.fault, jnp.asarray(10.0))
        assert float(health.thrust_fraction) == (0.5 if name == "thruster_weak" else 1.0)
        assert bool(health.gps) is (name != "gps_outage")
        assert bool(health.camera) is (name != "camera_blackout")


@pytest.mark.parametrize(
    ("key", "values"),
    [("fault.kind", ["wheel_stuck", "no_such_fault"]), ("fault.start_s", ["wheel_stuck"]), ("fault.kind", [1.0, 2.0])],
    ids=["a name of no fault", "names for a number", "numbers for a name"],
)
def test_only_kinds_of_fault_are_drawn_by_name_and_only_by_name(
    mission: ScenarioFile, key: str, values: list[Any]
) -> None:
    tables = mission.model_dump()
    with pytest.raises(ScenarioError):
        scenario_loader.validate(tables | {"dispersions": [{"key": key, "kind": "choice", "values": values}]})


@pytest.mark.parametrize(("key", "size"), [("target.tumble_axis", 3), ("target.attitude", 4)])
def test_directions_and_attitudes_are_unit_and_prefer_none(drawn: dict[str, np.ndarray], key: str, size: int) -> None:
    values = drawn[key]
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1.0, rtol=LAST_DIGITS)
    assert np.all(np.abs(values.mean(axis=0)) < FIVE_SIGMA)
    np.testing.assert_allclose(values.T @ values / RUNS, np.eye(size) / size, atol=FIVE_SIGMA)


def test_small_rotation_turns_the_nominal_attitude_by_its_sigma_per_axis(drawn: dict[str, np.ndarray]) -> None:
    conjugate = jnp.array(NOMINAL_ATTITUDE) * jnp.array([1.0, -1.0, -1.0, -1.0])
    turn = np.asarray(jax.vmap(lambda q: quaternion.multiply(q, conjugate))(jnp.asarray(drawn["camera.mounting"])))
    angles = np.rad2deg(2.0 * turn[:, 1:] / turn[:, :1])
    assert np.all(np.abs(angles.mean(axis=0) / [1.0, 2.0, 3.0]) < FIVE_SIGMA)
    np.testing.assert_allclose(angles.std(axis=0), [1.0, 2.0, 3.0], rtol=2.0 * FIVE_SIGMA)


def test_different_keys_and_different_seeds_draw_independent_numbers(mission: ScenarioFile) -> None:
    keys = ("servicer.mass_kg", "thruster.force_n")
    file = dispersed(mission, *(dispersion_kinds.Normal(key=key, kind="normal", sigma=1.0) for key in keys))
    first, second = draw(file, np.arange(RUNS)), draw(file, np.arange(RUNS), seed=4)
    mass, force, other = first[keys[0]], first[keys[1]], second[keys[0]]
    assert abs(np.corrcoef(mass, force)[0, 1]) < FIVE_SIGMA
    assert abs(np.corrcoef(mass, other)[0, 1]) < FIVE_SIGMA


def test_a_draw_does_not_depend_on_other_dispersions_or_their_order(
    mission: ScenarioFile, drawn: dict[str, np.ndarray]
) -> None:
    fewer = draw(dispersed(mission, *ONE_OF_EACH[::-2]), np.arange(50))
    for key, values in fewer.items():
        np.testing.assert_allclose(values, drawn[key][:50], rtol=LAST_DIGITS, atol=LAST_DIGITS)


def test_a_draw_does_not_depend_on_the_batch_or_the_order_of_runs(
    mission: ScenarioFile, drawn: dict[str, np.ndarray]
) -> None:
    some = [3999, 17, 0]
    alone = draw(dispersed(mission, *ONE_OF_EACH), some)
    for key, values in alone.items():
        np.testing.assert_allclose(values, drawn[key][some], rtol=LAST_DIGITS, atol=LAST_DIGITS)


def every_key(file: ScenarioFile) -> list[str]:
    """All keys of a scenario that can be dispersed."""
    sections = {name: type(getattr(file, name)) for name in type(file).model_fields}
    keys = [f"{name}.{key}" for name, cls in sections.items() for key in getattr(cls, "model_fields", {})]
    return [key for key in keys if nominal_of_key(file, key) is not None]


def _any_dispersion(key: str) -> Any:
    """A dispersion that the key can have; kinds of fault have names, wheels have numbers, and neither has a sigma."""
    if key == "fault.kind":
        return dispersion_kinds.Choice(key=key, kind="choice", values=["gps_outage"])
    if key == "fault.wheel":
        return dispersion_kinds.Choice(key=key, kind="choice", values=[2.0])
    return dispersion_kinds.Normal(key=key, kind="normal", sigma=0.01)


def test_the_value_used_is_the_value_drawn_for_every_key_there_is(mission: ScenarioFile) -> None:
    keys = every_key(mission)
    assert len(keys) > 60
    file = dispersed(mission, *(_any_dispersion(key) for key in keys))
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    values = dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(0), 1), {})
    used = dispersed_values.read_back(dispersed_values.apply_to_params(nominal, values), keys)
    for key in keys:
        np.testing.assert_allclose(used[key], values[key], rtol=LAST_DIGITS, err_msg=key)
        assert not np.array_equal(used[key], np.asarray(nominal_of_key(file, key))), key
