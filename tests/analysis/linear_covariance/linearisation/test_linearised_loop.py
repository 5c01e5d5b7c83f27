"""Jacobian of a tick against central differences, and the deviation vector."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.linear_covariance.linearisation import deviation_vector, target_outline_ensemble
from rpojax.analysis.linear_covariance.linearisation.deviation_vector import PENDING_BURN, make_layout
from rpojax.analysis.linear_covariance.linearisation.linearised_loop import OUTPUTS, LinearisedLoop
from rpojax.core.pytree import replace
from rpojax.flight.stages import Stages
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.simulation import initial_state
from rpojax.simulation.noise import InitialNoise, run_key
from rpojax.simulation.state import State
from rpojax.simulation.step import step as simulate_tick

CONSTANTS = (("plant", "thruster", "force_scale"), ("camera", "misalignment"), ("star_tracker", "misalignment"))
STEP = 5e-5
"""Of a central difference, in units of `scales`."""

quick = partial(
    jax.jit,
    compiler_options={"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True},
)
"""Compiles fast what is called a few times."""

RADIUS = 7e6
"""Of the orbit [m]."""

Nominal = tuple[Scenario, Params, State]


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    """The packaged scenario at its start, slightly off its mean; box edges in pixels."""
    file = scenario_loader.load("inspection", ["initial.relative_position_m=[1.0, -50.0, 2.0]"])
    static = static_settings(file)
    base = params.build_params(file.model_dump(), static.width_px, static.height_px)
    base = replace(base, camera=replace(base.camera, edge_noise=jnp.ones(())))
    zero = InitialNoise(
        biases=jnp.zeros(6), box_edge_errors=None, handover=jnp.zeros(12), star_tracker=jnp.zeros(3), gyro=jnp.zeros(3)
    )
    start = jax.jit(lambda key: initial_state.init(static, base, key, zero))
    return static, base, start(run_key(0, 0))


@pytest.fixture(scope="module")
def loop(nominal: Nominal) -> LinearisedLoop:
    static, base, state = nominal
    return LinearisedLoop(static, base, make_layout(state, base, CONSTANTS), Stages())


def scales(loop: LinearisedLoop) -> np.ndarray:
    """Changes of the vector of comparable effect."""
    found = np.ones(loop.layout.size + loop.noise_vector.size)
    for name, part in loop.layout.slices.items():
        quaternion = name.split(".")[-1].startswith("q_")
        small = quaternion or any(word in name for word in ("omega", "bias_B", "gyro_B", "misalignment", "remainder"))
        found[part] = 1e-3 if small else 0.1 if "r_" in name.split(".")[-1] else 1e-2
    return found


@pytest.fixture(scope="module")
def tick(nominal: Nominal, loop: LinearisedLoop) -> tuple[Callable[[jax.Array], jax.Array], np.ndarray]:
    """The step function, and the vector of the nominal run."""
    _, base, state = nominal
    own = target_outline_ensemble.target_outline(loop.scenario, base, state.truth.q_TN, state.truth)
    larger = own + jnp.array([-2.0, -1.0, 3.0, 1.0])
    drawn = deviation_vector.zero_noise(loop.scenario.substeps, larger - own, jnp.ones((), dtype=bool))
    step = loop.step(state, drawn, target_outline_ensemble.relative_box(own, larger))
    return step, np.asarray(loop.nominal_vector(state))


def test_unpacking_inverts_packing(nominal: Nominal, loop: LinearisedLoop) -> None:
    _, base, state = nominal
    again = loop.layout.unpack(loop.layout.pack(state, base), state, base)
    for found, expected in zip(jax.tree.leaves(again), jax.tree.leaves((state, base)), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_quaternion_signs_are_matched(nominal: Nominal, loop: LinearisedLoop) -> None:
    _, base, state = nominal
    turned = replace(state, truth=replace(state.truth, q_BN=-state.truth.q_BN))
    signs = loop.layout.quaternion_signs(*(np.asarray(loop.layout.pack(each, base)) for each in (state, turned)))
    assert np.flatnonzero(signs < 0.0).tolist() == list(range(*loop.layout.slices["truth.q_BN"].indices(99)))


def test_a_pending_burn_changes_truth_and_estimate_alike(loop: LinearisedLoop) -> None:
    vector = np.zeros(loop.layout.size)
    vector[loop.layout.slices[PENDING_BURN]] = [1.0, 2.0, 3.0, 4.0]
    after = loop.layout.burn_jump() @ vector
    assert not np.any(after[loop.layout.slices[PENDING_BURN]])
    for name, sign in (("truth.v_ST_N", 1.0), ("flight.orbit.servicer.v_SN_N", 1.0)):
        np.testing.assert_array_equal(after[loop.layout.slices[name]], sign * np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(after[loop.layout.slices["flight.orbit.relative.v_TS_N"]], [-1.0, -2.0, -3.0])
    assert after[loop.layout.slices["truth.delta_v"]] == 4.0
    assert np.count_nonzero(after) == 10


@pytest.mark.slow
def test_the_step_function_is_a_tick_of_the_loop(
    nominal: Nominal, loop: LinearisedLoop, tick: tuple[Callable[[jax.Array], jax.Array], np.ndarray]
) -> None:
    static, base, state = nominal
    step, point = tick
    found = np.asarray(quick(step)(jnp.asarray(point)))
    shift = jnp.array([-2.0, -1.0, 3.0, 1.0])
    drawn = deviation_vector.zero_noise(static.substeps, shift, jnp.ones((), dtype=bool))
    after, _ = quick(lambda state: simulate_tick(static, base, state, Stages(), drawn))(state)
    for path in loop.layout.states:
        expected = np.ravel(params.get_leaf(after, path))
        part = found[loop.layout.slices[".".join(path)]]
        np.testing.assert_allclose(part, expected, rtol=1e-12, atol=1e-12 * (1.0 + np.abs(expected).max()))


def test_directional_derivatives_of_the_tick_are_its_central_differences(
    loop: LinearisedLoop, tick: tuple[Callable[[jax.Array], jax.Array], np.ndarray]
) -> None:
    step, point = tick
    # One program: the values beside the derivatives.
    with_slope = quick(lambda at, along: jax.jvp(step, (at,), (along,)))
    scale, size = scales(loop), loop.layout.size
    rng = np.random.default_rng(0)
    for _ in range(6):
        along = jnp.asarray(scale * rng.normal(size=len(scale)))
        value, found = map(np.asarray, with_slope(jnp.asarray(point), along))
        ahead, behind = (
            np.asarray(with_slope(jnp.asarray(point) + sign * STEP * along, along)[0]) for sign in (1.0, -1.0)
        )
        difference = (ahead - behind) / (2.0 * STEP)
        # What positions in N are rounded to, over the step; errors of the servicer and its GPS are differences.
        noise = 4e-16 * np.abs(value) / STEP
        noise[size:][OUTPUTS["servicer_error_H"]] = 4e-16 * RADIUS / STEP
        noise[loop.layout.slices["flight.orbit.servicer.gps_error_N"]] = 4e-16 * RADIUS / STEP
        units = np.concatenate([scale[:size], np.full(len(found) - size, 0.1)])
        np.testing.assert_array_less(np.abs(found - difference), 2e-5 * units + 4.0 * noise)
