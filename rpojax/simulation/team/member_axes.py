"""Records of the members of a team: equal leaves are shared, others have the members along a last axis."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params, leaf_path_and_factor, replace_leaf

T = TypeVar("T")


@dataclass(frozen=True)
class TeamParams:
    """Parameters of the members of a team.

    Attributes:
        leaves: parameters, with the members along the last axis where `axes` says so
        axes: the same record with -1 for a leaf of each member, None for one that all share
        count: number of members
        mode: how a function of one member is batched over them, by default as the environment says
    """

    leaves: Params
    axes: Params
    count: int
    mode: BatchingMode | None = None

    def each(self, function: Callable[..., Any], in_axes: Any = -1, out_axes: Any = -1) -> Callable[..., Any]:
        """A function of one member's parameters and other records, as one of the records of all members."""

        def mapped(*records: Any) -> Any:
            axes = in_axes if isinstance(in_axes, tuple) else (in_axes,) * len(records)
            transform = batching_mode.transform(self.mode)
            return transform(function, in_axes=(self.axes, *axes), out_axes=out_axes)(self.leaves, *records)

        return mapped

    def member(self, number: Int[Array, ""] | int) -> Params:
        """Parameters of one member."""
        return jax.tree.map(
            lambda axis, leaf: leaf if axis is None else take(jnp.asarray(leaf), number),
            self.axes,
            self.leaves,
            is_leaf=lambda node: node is None,
        )

    def of_each(self, choose: Callable[[Params], T]) -> T:
        """Part of the parameters with all its leaves (..., members)."""
        return self.each(lambda params: choose(params))()


def stack_members(members: Sequence[Params], mode: BatchingMode | None = None) -> TeamParams:
    """Parameters of a team from those of its members: leaves that are equal in all of them are shared."""
    trees = [jax.tree.flatten(member) for member in members]
    columns = list(zip(*(leaves for leaves, _ in trees), strict=True))
    equal = [all(np.array_equal(column[0], other) for other in column[1:]) for column in columns]
    leaves = [
        column[0] if is_equal else np.stack([np.asarray(leaf) for leaf in column], axis=-1)
        for column, is_equal in zip(columns, equal, strict=True)
    ]
    tree = trees[0][1]
    axes = jax.tree.unflatten(tree, [None if is_equal else -1 for is_equal in equal])
    return TeamParams(jax.tree.unflatten(tree, leaves), axes, len(members), mode)


def with_values(team: TeamParams, values: Values, common: Collection[str]) -> TeamParams:
    """Parameters of a run of the team with dispersed values: (...) of `common` keys, (..., members) of others."""
    axes = team.axes
    for key in values:
        path, _ = leaf_path_and_factor(key, team.leaves)
        axes = replace_leaf(axes, path, None if key in common else -1)
    return TeamParams(dispersed_values.apply_to_params(team.leaves, values), axes, team.count, team.mode)


def take(leaf: Array, number: Int[Array, ""] | int) -> Array:
    """Element of the last axis, as a sum over the axis."""
    chosen = _flags(leaf, number)
    if leaf.dtype == jnp.bool_:
        return jnp.any(leaf & chosen, axis=-1)
    return jnp.sum(jnp.where(chosen, leaf, jnp.zeros((), leaf.dtype)), axis=-1, dtype=leaf.dtype)


def put(leaf: Array, number: Int[Array, ""] | int, value: Array) -> Array:
    """The array with an element of the last axis replaced."""
    return jnp.where(_flags(leaf, number), value[..., None], leaf)


def _flags(leaf: Array, number: Int[Array, ""] | int) -> Bool[Array, "..."]:
    """Flags of the shape of an array of its elements in one place of the last axis."""
    chosen = jnp.arange(leaf.shape[-1], dtype=jnp.int32) == number
    return jnp.broadcast_to(chosen, leaf.shape)
