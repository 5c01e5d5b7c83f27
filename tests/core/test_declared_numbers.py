"""A declaration on a record changes nothing of it in JAX, and says what the number is."""

import jax
import jax.numpy as jnp
import pytest
from jaxtyping import Array

from rpojax.core.declared_numbers import declared_numbers, number
from rpojax.core.pytree import pytree, replace
from rpojax.physics.thruster import Thruster


@pytree
class Plain:
    """Two numbers."""

    mass: Array
    angle: Array


@pytree
class Declared:
    """Two numbers."""

    mass: Array = number("mass at the start", unit="kg", above=0.0)
    angle: Array = number("angle about the axis", unit="deg", default=3.0)


def test_the_leaves_of_a_record_are_those_without_declarations() -> None:
    plain, declared = (cls(mass=jnp.float64(1.0), angle=jnp.float64(2.0)) for cls in (Plain, Declared))
    assert jax.tree.leaves(plain) == jax.tree.leaves(declared)
    assert jax.tree.structure(declared) == jax.tree.structure(replace(declared, mass=jnp.float64(5.0)))
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(declared)]
    assert paths == [".mass", ".angle"]


def test_the_key_is_the_name_with_the_unit_unless_one_is_declared() -> None:
    assert [key for key, _ in declared_numbers(Declared).values()] == ["mass_kg", "angle_deg"]
    assert declared_numbers(Plain) == {}
    assert declared_numbers(Thruster)["force"][0] == "force_n"


def test_the_docstring_has_the_meanings_of_declared_numbers() -> None:
    assert "angle: angle about the axis; key `angle_deg`" in (Declared.__doc__ or "")
    assert Plain.__doc__ == "Two numbers."


def test_a_default_is_one_of_the_key_and_not_of_the_record() -> None:
    with pytest.raises(TypeError, match="angle"):
        Declared(mass=jnp.float64(1.0))
