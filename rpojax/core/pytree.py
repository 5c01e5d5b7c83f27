"""Frozen dataclasses of arrays that are JAX pytrees, and operations on pytrees."""

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar, dataclass_transform

import jax
import numpy as np
from jax.export import register_pytree_node_serialization

from rpojax.core.declared_numbers import described, number

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(dataclasses.field, number))
def pytree(cls: type[T]) -> type[T]:
    """Makes `cls` a frozen keyword-only dataclass whose every field is a pytree child."""
    frozen = dataclasses.dataclass(frozen=True, kw_only=True)(cls)
    frozen.__doc__ = described(frozen)
    record = jax.tree_util.register_dataclass(frozen)
    # Exported functions of such records can then be serialised. A class that a notebook defines again keeps the first.
    with contextlib.suppress(ValueError):
        name = f"{cls.__module__}.{cls.__qualname__}"
        register_pytree_node_serialization(
            record, serialized_name=name, serialize_auxdata=lambda _: b"", deserialize_auxdata=lambda _: ()
        )
    return record


def replace(record: T, **changes: Any) -> T:
    """Returns a copy of the dataclass `record` with some fields changed."""
    return dataclasses.replace(record, **changes)  # pyright: ignore[reportArgumentType, reportCallIssue]


def concatenate(parts: Sequence[T], axis: int = 0) -> T:
    """Joins pytrees of the same structure: each array concatenated along an axis, in NumPy."""
    return jax.tree.map(lambda *arrays: np.concatenate([np.asarray(each) for each in arrays], axis=axis), *parts)


def select(condition: jax.Array, if_true: T, if_false: T) -> T:
    """Returns one of two pytrees of the same structure by a scalar boolean; both are evaluated."""
    return jax.tree.map(lambda a, b: jax.numpy.where(condition, a, b), if_true, if_false)
