"""Quaternion algebra against worked cases, Rodrigues' formula and its own identities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import IDENTITY, SEEDS, attitude_difference, axis_angle_quaternion, random_unit, rotation_matrix

from rpojax.core import quaternion

EXACT = 1e-14  # a few roundings of numbers near one
NEAR_PI = 1e-9  # the half angle's cosine vanishes, so the angle is known only through the sine of its complement

between = jax.jit(quaternion.rotation_vector_between)
derivative = jax.jit(quaternion.derivative)
exp = jax.jit(quaternion.exp)
from_matrix = jax.jit(quaternion.from_matrix)
log = jax.jit(quaternion.log)
multiply = jax.jit(quaternion.multiply)
propagate = jax.jit(quaternion.propagate)
rotate = jax.jit(quaternion.rotate)
to_matrix = jax.jit(quaternion.to_matrix)


def test_a_body_turned_by_90_degrees_about_z_sees_the_inertial_y_axis_as_its_x_axis() -> None:
    root = np.sqrt(0.5)
    q_BN = propagate(IDENTITY, np.array([0.0, 0.0, np.pi / 2]), 1.0)
    np.testing.assert_allclose(q_BN, [root, 0.0, 0.0, -root], atol=EXACT)
    np.testing.assert_allclose(rotate(q_BN, np.array([0.0, 1.0, 0.0])), [1.0, 0.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(to_matrix(q_BN), [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=EXACT)


def test_the_rotation_vector_rotates_by_the_right_hand_rule() -> None:
    q = exp(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(rotate(q, np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], atol=EXACT)


@given(SEEDS)
def test_the_matrix_of_a_product_is_the_product_of_the_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, p = random_unit(rng, 4), random_unit(rng, 4)
    np.testing.assert_allclose(to_matrix(multiply(q, p)), rotation_matrix(q) @ rotation_matrix(p), atol=EXACT)


@given(SEEDS)
def test_rotating_a_vector_is_multiplying_by_the_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, v = random_unit(rng, 4), rng.normal(size=3)
    np.testing.assert_allclose(rotate(q, v), rotation_matrix(q) @ v, atol=10 * EXACT)


@given(SEEDS)
def test_a_quaternion_and_its_negative_are_the_same_rotation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, v = random_unit(rng, 4), rng.normal(size=3)
    np.testing.assert_array_equal(rotate(q, v), rotate(-q, v))
    np.testing.assert_array_equal(to_matrix(q), to_matrix(-q))
    np.testing.assert_array_equal(log(q), log(-q))


@given(SEEDS)
def test_the_conjugate_is_the_inverse_rotation(seed: int) -> None:
    q = random_unit(np.random.default_rng(seed), 4)
    product = multiply(q, quaternion.conjugate(jnp.asarray(q)))
    np.testing.assert_allclose(product, IDENTITY, atol=EXACT)


@given(SEEDS, st.floats(-12.0, np.log10(3.1)))
def test_log_is_the_inverse_of_exp_below_half_a_turn(seed: int, exponent: float) -> None:
    rotation = 10.0**exponent * random_unit(np.random.default_rng(seed))
    q = exp(rotation)
    np.testing.assert_allclose(q, axis_angle_quaternion(rotation, 10.0**exponent), atol=EXACT)
    np.testing.assert_allclose(log(q), rotation, rtol=0.0, atol=1e-13 * 10.0**exponent + 1e-30)


def test_exp_and_log_are_exact_at_zero() -> None:
    np.testing.assert_array_equal(exp(np.zeros(3)), IDENTITY)
    np.testing.assert_array_equal(log(IDENTITY), np.zeros(3))


def test_exp_and_log_of_half_a_turn_are_inverse_up_to_the_sign() -> None:
    half_turn = np.pi * np.array([0.6, 0.0, 0.8])
    q = np.asarray(exp(half_turn))
    np.testing.assert_allclose(q, [0.0, 0.6, 0.0, 0.8], atol=EXACT)
    found = np.asarray(log(q))
    assert min(np.max(np.abs(found - half_turn)), np.max(np.abs(found + half_turn))) < NEAR_PI


@given(SEEDS)
def test_the_rotation_between_two_directions_takes_the_first_to_the_second_the_short_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_unit(rng), random_unit(rng)
    phi = np.asarray(between(a, b))
    np.testing.assert_allclose(rotate(exp(phi), a), b, atol=10 * EXACT)
    np.testing.assert_allclose(np.linalg.norm(phi), np.arccos(np.clip(a @ b, -1.0, 1.0)), atol=1e-7)
    np.testing.assert_allclose([phi @ a, phi @ b], 0.0, atol=10 * EXACT)


@given(SEEDS)
def test_the_rotation_between_opposite_directions_is_half_a_turn(seed: int) -> None:
    a = random_unit(np.random.default_rng(seed))
    phi = np.asarray(between(a, -a))
    np.testing.assert_allclose(np.linalg.norm(phi), np.pi, atol=NEAR_PI)
    np.testing.assert_allclose(rotate(exp(phi), a), -a, atol=NEAR_PI)


@pytest.mark.parametrize("axis", range(3))
def test_the_rotation_between_opposite_coordinate_axes_is_half_a_turn(axis: int) -> None:
    a = np.eye(3)[axis]
    np.testing.assert_allclose(rotate(exp(between(a, -a)), a), -a, atol=EXACT)


def test_the_rotation_between_equal_directions_is_zero() -> None:
    a = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(between(a, a), np.zeros(3), atol=1e-16)


@pytest.mark.parametrize("dominant", range(4))
def test_from_matrix_inverts_to_matrix_for_any_dominant_component(dominant: int) -> None:
    rng = np.random.default_rng(dominant)
    for _ in range(10):
        q = rng.normal(size=4)
        q[dominant] = 4.0 * np.sign(q[dominant])
        q /= np.linalg.norm(q)
        assert attitude_difference(np.asarray(from_matrix(rotation_matrix(q))), q) < 10 * EXACT


@pytest.mark.parametrize("diagonal", [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_matrices_of_identity_and_of_half_turns_about_the_axes_are_exact(diagonal: tuple[int, int, int]) -> None:
    q = np.asarray(from_matrix(np.diag(np.array(diagonal, dtype=float))))
    expected = IDENTITY if sum(diagonal) == 3 else np.concatenate([[0.0], np.array(diagonal) > 0])
    np.testing.assert_array_equal(np.abs(q), expected)


@given(SEEDS)
def test_propagation_solves_the_differential_equation_of_the_derivative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, omega, h = random_unit(rng, 4), 0.5 * random_unit(rng), 1e-4
    slope = (np.asarray(propagate(q, omega, h)) - np.asarray(propagate(q, omega, -h))) / (2 * h)
    # Central difference: truncation h^2 omega^3 / 48 and rounding 1e-16 / h.
    np.testing.assert_allclose(derivative(q, omega), slope, atol=1e-10)


@given(SEEDS)
def test_two_propagations_at_a_constant_rate_equal_one_over_their_sum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, omega = random_unit(rng, 4), 0.3 * random_unit(rng)
    twice = propagate(propagate(q, omega, 1.5), omega, 2.5)
    np.testing.assert_allclose(twice, propagate(q, omega, 4.0), atol=EXACT)


@given(SEEDS)
def test_normalisation_gives_unit_length_and_keeps_the_direction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, length = random_unit(rng, 4), 10.0 ** rng.uniform(-3, 3)
    np.testing.assert_allclose(quaternion.normalize(jnp.asarray(length * q)), q, atol=EXACT)
