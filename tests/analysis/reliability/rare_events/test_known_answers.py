"""Probabilities with known answers: the intervals hold, and what cannot be estimated says so."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from experiment_modules import load_experiment
from jaxtyping import Array
from scipy.stats import norm

import rpojax
from rpojax.analysis.reliability.rare_events.probability_estimate import MethodChoice

PROBLEMS = load_experiment("probability/known_problems.py")
PUBLIC = {problem.name: problem for problem in PROBLEMS.PUBLIC}
BETA = 4.0
SIGMA = 0.7
"""Standard deviation of the noise in a margin."""


@jax.jit
def plane(z: Array) -> Array:
    """A plane at four sigmas in three dimensions."""
    return BETA - jnp.sum(z, axis=1) / math.sqrt(3.0)


@pytest.mark.parametrize("name", ["RP110", "RP107", "10-dimensional hypersphere"])
def test_public_problems_lie_in_the_interval(name: str) -> None:
    problem = PUBLIC[name]
    found = rpojax.estimate_probability(jax.jit(problem.limit_state), problem.dimension, budget=6000, seed=2)
    low, high = found.interval_95
    assert low <= problem.probability <= high
    assert found.trusted
    assert found.evaluations <= 6000
    assert found.coefficient_of_variation < (0.1 if problem.probability > 1e-3 else 0.3)


@pytest.mark.parametrize("method", ["auto", "subset", "importance", "line"])
def test_every_method_knows_a_plane(method: MethodChoice) -> None:
    found = rpojax.estimate_probability(plane, 3, budget=4000, seed=1, method=method)
    assert found.interval_95[0] <= norm.sf(BETA) <= found.interval_95[1]
    assert found.method == ("importance" if method == "auto" else method)
    assert found.reason
    if method in ("importance", "line"):
        assert found.design_points[0].distance == pytest.approx(BETA, abs=0.3)


@pytest.mark.parametrize("noise_dimension", [30, 400])
def test_noise_is_in_the_probability(noise_dimension: int) -> None:
    """Its sum is a normal number, so that the margin is one, too; 400 numbers are drawn anew instead of moved."""

    @jax.jit
    def limit_state(z: Array, noise: Array) -> Array:
        assert noise.shape == (len(z), noise_dimension)
        return 3.5 - z[:, 0] - SIGMA * jnp.sum(noise, axis=1) / math.sqrt(noise_dimension)

    truth = float(norm.sf(3.5 / math.hypot(1.0, SIGMA)))
    found = rpojax.estimate_probability(limit_state, 2, budget=4000, seed=3, noise_dimension=noise_dimension)
    assert found.interval_95[0] <= truth <= found.interval_95[1]
    assert found.probability == pytest.approx(truth, rel=0.5)


def test_line_sampling_says_that_failure_has_several_sides() -> None:
    problem = PUBLIC["four-branch"]
    found = rpojax.estimate_probability(jax.jit(problem.limit_state), 2, budget=3000, method="line")
    assert not found.trusted
    assert any("more than one side" in warning for warning in found.warnings)


def test_importance_sampling_tells_the_regions() -> None:
    found = rpojax.estimate_probability(jax.jit(lambda z: 3.5 - jnp.abs(z[:, 0])), 2, budget=3000)
    assert any("opposite sides" in warning for warning in found.warnings)
    assert sorted(point.x[0] for point in found.design_points) == pytest.approx([-3.5, 3.5], abs=0.1)


def test_subset_simulation_cannot_rank_flat_margins() -> None:
    flat = jax.jit(lambda z: jnp.where(z[:, 0] > 4.0, -1.0, 1.0))
    found = rpojax.estimate_probability(flat, 2, budget=2000, method="subset")
    assert not found.trusted
    assert any("cannot rank" in warning for warning in found.warnings)
    assert found.interval_95[0] <= norm.sf(4.0) <= found.interval_95[1]
    assert (found.method, found.reason) == ("plain", "subset simulation, asked for, did not reach failure")


def test_what_never_fails_is_bounded() -> None:
    found = rpojax.estimate_probability(jax.jit(lambda z: 1.0 + z[:, 0] ** 2), 2, budget=1000)
    assert found.probability == 0.0
    assert not found.trusted
    assert found.interval_95[0] == 0.0
    assert 0.0 < found.interval_95[1] < 0.02
    assert found.to_dict()["coefficient_of_variation"] is None


def test_what_always_fails_is_certain() -> None:
    found = rpojax.estimate_probability(jax.jit(lambda z: -1.0 - z[:, 0] ** 2), 2, budget=1000)
    assert found.probability == 1.0
    assert found.trusted
    assert found.method == "plain"


def test_undefined_margins_are_failures_and_told() -> None:
    found = rpojax.estimate_probability(
        jax.jit(lambda z: jnp.where(z[:, 0] > 3.5, jnp.nan, 1.0 - z[:, 1] / 9.0)), 2, budget=4000
    )
    assert found.interval_95[0] <= norm.sf(3.5) <= found.interval_95[1]
    assert not found.trusted
    assert any("no defined margin" in warning for warning in found.warnings)


@pytest.mark.parametrize("seed", range(3))
def test_lines_find_where_margins_become_undefined(seed: int) -> None:
    def undefined_beyond(z: Array) -> Array:
        return jnp.where(z[:, 0] > 3.0, jnp.nan, 1.0)

    found = rpojax.estimate_probability(jax.jit(undefined_beyond), 3, method="line", budget=4000, seed=seed)
    assert found.interval_95[0] <= norm.sf(3.0) <= found.interval_95[1]
    assert found.probability == pytest.approx(norm.sf(3.0), rel=0.15)
    assert not found.trusted
    assert any("no defined margin" in warning for warning in found.warnings)


STEPS = {
    "whole numbers": (lambda z: jnp.floor(3.0 - z[:, 0]), 2.0),
    "whole numbers above": (lambda z: jnp.ceil(3.0 - z[:, 0]), 3.0),
    "halves": (lambda z: jnp.floor(2.0 * (3.0 - z[:, 0])) / 2.0, 2.5),
    "on the limit beyond a step": (lambda z: jnp.where(z[:, 0] > 2.6, 0.0, 3.0 - z[:, 0]), 2.6),
    "barely beyond a step": (lambda z: jnp.where(z[:, 0] > 2.6, -1e-9, 5.0), 2.6),
    "across": (lambda z: jnp.floor(4.0 * (3.0 - (z[:, 0] + z[:, 1]) / math.sqrt(2.0))), 2.75),
    "a bend": (lambda z: jnp.minimum(3.1 - z[:, 0], 20.0 * (2.9 - z[:, 0])), 2.9),
}


@pytest.mark.parametrize("name", STEPS)
def test_lines_find_steps_of_the_margin(name: str) -> None:
    margin, distance = STEPS[name]
    compiled = jax.jit(margin)
    for seed in range(3):
        found = rpojax.estimate_probability(compiled, 3, method="line", budget=4000, seed=seed)
        assert found.interval_95[0] <= norm.sf(distance) <= found.interval_95[1]
        assert found.probability == pytest.approx(norm.sf(distance), rel=0.15)
        assert found.trusted


def test_lines_are_trusted_where_only_far_points_have_no_margin() -> None:
    found = rpojax.estimate_probability(
        jax.jit(lambda z: jnp.where(z[:, 0] > 5.0, jnp.nan, 3.0 - z[:, 0])), 3, method="line", budget=4000
    )
    assert found.probability == pytest.approx(norm.sf(3.0), rel=0.05)
    assert found.trusted
    assert any("no defined margin" in warning for warning in found.warnings)


def test_a_probability_of_points_without_a_margin_is_not_trusted() -> None:
    found = rpojax.estimate_probability(
        jax.jit(lambda z: jnp.where(z[:, 0] > 0.0, jnp.nan, 1.0)), 2, method="plain", budget=1000
    )
    assert found.probability == pytest.approx(0.5, abs=0.06)
    assert not found.trusted
    assert any("100 % of the estimate are points without a defined margin" in warning for warning in found.warnings)


def test_an_estimate_depends_on_its_seed_alone() -> None:
    first, again, other = (rpojax.estimate_probability(plane, 3, budget=1000, seed=seed) for seed in (5, 5, 6))
    assert first.to_dict() == again.to_dict()
    assert repr(first).startswith("Probability of failure ")
    assert f"  method   {first.method}" in repr(first)
    table = first.to_dataframe()
    assert table["evaluations"].sum() == sum(level.evaluations for level in first.levels) > 0
    assert table["name"].tolist() == [level.name for level in first.levels]
    assert first.probability != other.probability


def test_no_more_points_are_evaluated_than_the_budget() -> None:
    counted: list[int] = []

    def limit_state(z: Array) -> Array:
        counted.append(len(z))
        return plane(z)

    for method in ("auto", "subset", "importance", "line", "plain"):
        counted.clear()
        found = rpojax.estimate_probability(limit_state, 3, budget=1234, method=method)
        assert sum(counted) == found.evaluations <= 1234


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"dimension": 0}, "dimension"),
        ({"budget": 10}, "budget"),
        ({"seed": -1}, "seed"),
        ({"noise_dimension": -1}, "noise_dimension"),
        ({"method": "guess"}, "method"),
        ({"limit_state": lambda z: z}, "limit_state"),
    ],
)
def test_arguments_that_cannot_be_used_are_named(change: dict, named: str) -> None:
    arguments = {"limit_state": plane, "dimension": 3, "budget": 500, **change}
    with pytest.raises(rpojax.RpojaxError, match=f"^{named}: found"):
        rpojax.estimate_probability(arguments.pop("limit_state"), arguments.pop("dimension"), **arguments)


def test_the_answers_of_the_benchmark_are_those_of_quadrature() -> None:
    """Plain sampling of the frequent ones, with a fixed seed, within four standard errors."""
    rng = np.random.default_rng(0)
    for name in ("four-branch", "RP22", "RP31", "RP14", "one-sided parabola"):
        problem = PUBLIC[name]
        margins = jax.jit(problem.limit_state)(rng.standard_normal((200_000, problem.dimension)))
        share = float(np.mean(np.asarray(margins) <= 0.0))
        assert share == pytest.approx(problem.probability, abs=4.0 * math.sqrt(problem.probability / 200_000))
