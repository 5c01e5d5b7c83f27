"""Batching with the items in the last axis of every array on the way, whatever a function does with its axes.

`jax.vmap` lets each operation choose where the items go, and stacking moves them to the front: compiled loops then run
over the three components of a vector. Here they always run over the items, which lie side by side in memory.
"""

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend import core

from rpojax.core.trailing_rules import RULES, Value, spread

_CALLS = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2"}


def batch(function: Callable[..., Any], in_axes: Any, out_axes: Any) -> Callable[..., Any]:
    """A function of one item as a function of many that lie along the last axes of its arguments and results.

    Axes are given as to `jax.vmap`: -1 for what every item has of its own, None for what they have in common.

    Raises:
        ValueError: a result that was said to be in common differs from item to item.
    """

    def batched(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        given = [Value(leaf, axis is not None) for leaf, axis in zip(leaves, _flat(in_axes, args), strict=True)]
        size = next(value.array.shape[-1] for value in given if value.many)
        traced, shape = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, map(_item, given)))
        results = _Evaluation(size).call(traced, given)
        axes = _flat(out_axes, shape)
        arrays = [_result(value, axis, size) for value, axis in zip(results, axes, strict=True)]
        return jax.tree.unflatten(jax.tree.structure(shape), arrays)

    return batched


def _flat(axes: Any, tree: Any) -> list[int | None]:
    """The axis of each array of a tree, from axes given for whole branches of it."""
    flat: list[int | None] = []

    def note(axis: int | None, branch: Any) -> None:
        flat.extend([axis] * len(jax.tree.leaves(branch)))

    jax.tree.map(note, axes, tree, is_leaf=lambda node: node is None)
    return flat


def _item(value: Value) -> jax.ShapeDtypeStruct:
    shape = jnp.shape(value.array)
    return jax.ShapeDtypeStruct(shape[:-1] if value.many else shape, jnp.result_type(value.array))


def _result(value: Value, axis: int | None, size: int) -> Any:
    if axis is not None:
        return spread(value, size)
    if value.many:
        raise ValueError("out_axes: found None for a result that differs from item to item, expected -1")
    return value.array


class _Evaluation:
    """Operations of one item carried out for `size` of them."""

    def __init__(self, size: int) -> None:
        self._size = size

    def call(self, closed: Any, given: Sequence[Value]) -> list[Value]:
        """Results of a traced function."""
        jaxpr, constants = getattr(closed, "jaxpr", closed), getattr(closed, "consts", ())
        known: dict[Any, Value] = dict(zip(jaxpr.constvars, (Value(each, False) for each in constants), strict=True))
        known.update(zip(jaxpr.invars, given, strict=True))

        def read(atom: Any) -> Value:
            if isinstance(atom, core.Literal):
                return Value(jnp.asarray(atom.val, dtype=atom.aval.dtype), False)  # pyright: ignore
            return known[atom]

        for equation in jaxpr.eqns:
            scope = str(equation.source_info.name_stack)
            with jax.named_scope(scope) if scope else contextlib.nullcontext():
                results = self._apply(equation, [read(atom) for atom in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _apply(self, equation: Any, given: list[Value]) -> list[Value]:
        name, params = equation.primitive.name, equation.params
        if name in _CALLS:
            return self.call(params.get("jaxpr") or params["call_jaxpr"], given)
        if name == "scan":
            return self._scan(params, given)
        if name == "cond":
            return self._cond(params["branches"], given[0], given[1:])
        if not any(value.many for value in given):
            return _values(equation, equation.primitive.bind(*(value.array for value in given), **params), False)
        rule = RULES.get(name)
        result = rule(equation, given, self._size) if rule else None
        if result is not None:
            return [Value(result, True)]
        axes = [-1 if value.many else None for value in given]
        every = jax.vmap(partial(equation.primitive.bind, **params), in_axes=axes, out_axes=-1)
        return _values(equation, every(*(value.array for value in given)), True)

    def _scan(self, params: dict[str, Any], given: list[Value]) -> list[Value]:
        first, last = params["num_consts"], params["num_consts"] + params["num_carry"]
        constants, carried, inputs = given[:first], given[first:last], given[last:]
        several = [value.many for value in inputs]
        many, found = [value.many for value in carried], []

        def body(state: list[Any], now: list[Any]) -> tuple[list[Any], list[Any]]:
            results = self.call(params["jaxpr"], [*constants, *map(Value, state, many), *map(Value, now, several)])
            found[:] = [value.many for value in results]
            return self._arrays(results[: len(many)], many), [value.array for value in results[len(many) :]]

        # What is carried differs between items if it does at first, or comes to on the way.
        now = [jax.ShapeDtypeStruct(jnp.shape(each.array)[1:], jnp.result_type(each.array)) for each in inputs]
        settled = False
        while not settled:
            jax.eval_shape(body, self._arrays(carried, many), now)
            grown = [before or after for before, after in zip(many, found, strict=False)]
            settled, many = grown == many, grown
        start, rest = self._arrays(carried, many), [value.array for value in inputs]
        how = {"length": params["length"], "reverse": params["reverse"], "unroll": params["unroll"]}
        end, seen = lax.scan(body, start, rest, **how)
        return [*map(Value, end, many), *map(Value, seen, found[len(many) :])]

    def _cond(self, branches: Sequence[Any], index: Value, given: list[Value]) -> list[Value]:
        many = [False] * len(branches[0].out_avals)
        kinds = [value.many for value in given]

        def run(branch: Any, *arrays: Any) -> list[Any]:
            results = self.call(branch, list(map(Value, arrays, kinds)))
            many[:] = [one or other.many for one, other in zip(many, results, strict=True)]
            return self._arrays(results, many)

        arrays = [value.array for value in given]
        for branch in branches:
            jax.eval_shape(partial(run, branch), *arrays)
        if not index.many:
            results = lax.switch(index.array, [partial(run, branch) for branch in branches], *arrays)
            return list(map(Value, results, many))
        many[:] = [True] * len(many)
        cases = zip(*(run(branch, *arrays) for branch in branches), strict=True)
        return [Value(_chosen(index.array, case), True) for case in cases]

    def _arrays(self, values: Sequence[Value], many: Sequence[bool]) -> list[Any]:
        return [
            spread(value, self._size) if several else jnp.asarray(value.array)
            for value, several in zip(values, many, strict=True)
        ]


def _values(equation: Any, result: Any, many: bool) -> list[Value]:
    return [Value(each, many) for each in (result if equation.primitive.multiple_results else [result])]


def _chosen(index: Any, cases: Sequence[Any]) -> Any:
    """For each item the case of its own index."""
    which = lax.broadcast_in_dim(index, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which.astype(bool) if len(cases) == 2 else which, *cases)
