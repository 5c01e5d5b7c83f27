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
import numpy as np
from jax import lax
from jax.extend import core

from rpojax.batching.primitive_rules import RULES, Items, Value

_CALLS = {"jit", "pjit", "closed_call", "core_call", "checkpoint", "remat2"}


def batch(function: Callable[..., Any], in_axes: Any, out_axes: Any) -> Callable[..., Any]:
    """A function of one item as a function of many that lie along the last axes of its arguments and results.

    Axes are given as to `jax.vmap`: -1 for what every item has of its own, None for what they have in common.
    To be called in a compiled function: else all that is made on the way is kept to the end.

    Raises:
        ValueError: a result that was said to be in common differs from item to item.
    """

    def batched(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        given = [Value(leaf, axis is not None) for leaf, axis in zip(leaves, _flat(in_axes, args), strict=True)]
        size = next(value.array.shape[-1] for value in given if value.many)
        traced, shape = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, map(_item, given)))
        evaluation = _Evaluation(size)
        results = evaluation.call(traced, given)
        own = [axis is not None for axis in _flat(out_axes, shape)]
        if any(value.many and not several for value, several in zip(results, own, strict=True)):
            raise ValueError("out_axes: found None for a result that differs from item to item, expected -1")
        arrays = evaluation.arrays(results, own)
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


class _Evaluation:
    """Operations of one item carried out for `size` of them; one that has a rule once for the same numbers."""

    def __init__(self, size: int) -> None:
        self._items = Items(size)
        self._done: dict[Any, tuple[list[Value], list[Value]]] = {}

    def call(self, closed: Any, given: Sequence[Value]) -> list[Value]:
        """Results of a traced function."""
        jaxpr, constants = getattr(closed, "jaxpr", closed), getattr(closed, "consts", ())
        known: dict[Any, Value] = dict(zip(jaxpr.constvars, (Value(each, False) for each in constants), strict=True))
        known.update(zip(jaxpr.invars, given, strict=True))

        def read(atom: Any) -> Value:
            if isinstance(atom, core.Literal):
                return Value(np.asarray(atom.val, dtype=atom.aval.dtype), False)  # pyright: ignore[reportAttributeAccessIssue]
            return known[atom]

        for equation in jaxpr.eqns:
            scope = str(equation.source_info.name_stack)
            with jax.named_scope(scope) if scope else contextlib.nullcontext():
                results = self._apply(equation, [read(atom) for atom in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def arrays(self, values: Sequence[Value], many: Sequence[bool]) -> list[Any]:
        """Arrays of values, with an axis of items where they are to have `many`."""
        return [
            self._items.spread(value) if several else jnp.asarray(value.array)
            for value, several in zip(values, many, strict=True)
        ]

    def _apply(self, equation: Any, given: list[Value]) -> list[Value]:
        name, params = equation.primitive.name, equation.params
        if name in _CALLS:
            return self.call(params.get("jaxpr") or params["call_jaxpr"], given)
        if name == "scan":
            return self._scan(params, given)
        if name == "cond":
            return self._cond(params["branches"], given[0], given[1:])
        if name not in RULES:  # others may have effects, or hold functions
            return self._carried_out(equation, given)
        key = (name, tuple(sorted(params.items())), *(value.identity for value in given))
        if key not in self._done:
            # The numbers are kept as long as what was made of them, lest others get their identity.
            self._done[key] = given, self._carried_out(equation, given)
        return self._done[key][1]

    def _carried_out(self, equation: Any, given: list[Value]) -> list[Value]:
        name = equation.primitive.name
        if not any(value.many for value in given):
            return _values(equation, _bind(equation, *(value.array for value in given)), False)
        rule = RULES.get(name)
        result = rule(equation, given, self._items) if rule else None
        if result is not None:
            return [Value(result, True)]
        axes = [-1 if value.many else None for value in given]
        every = jax.vmap(partial(_bind, equation), in_axes=axes, out_axes=-1)
        return _values(equation, every(*(value.array for value in given)), True)

    def _scan(self, params: dict[str, Any], given: list[Value]) -> list[Value]:
        first, last = params["num_consts"], params["num_consts"] + params["num_carry"]
        constants, carried, inputs = given[:first], given[first:last], given[last:]
        several = [value.many for value in inputs]
        found = _scan_differs(params, [value.many for value in given])
        many = found[: len(carried)]

        def body(state: list[Any], now: list[Any]) -> tuple[list[Any], list[Any]]:
            inner = _Evaluation(self._items.size)
            results = inner.call(params["jaxpr"], [*constants, *map(Value, state, many), *map(Value, now, several)])
            return inner.arrays(results[: len(many)], many), [value.array for value in results[len(many) :]]

        start, rest = self.arrays(carried, many), [value.array for value in inputs]
        how = {"length": params["length"], "reverse": params["reverse"], "unroll": params["unroll"]}
        end, seen = lax.scan(body, start, rest, **how)
        return [*map(Value, end, many), *map(Value, seen, found[len(many) :])]

    def _cond(self, branches: Sequence[Any], index: Value, given: list[Value]) -> list[Value]:
        kinds = [value.many for value in given]
        many = _cond_differs(branches, [index.many, *kinds])

        def run(within: _Evaluation, branch: Any, *arrays: Any) -> list[Any]:
            return within.arrays(within.call(branch, list(map(Value, arrays, kinds))), many)

        arrays = [value.array for value in given]
        if not index.many:
            # What is made in a branch is for that branch alone, each time that it is traced.
            apart = [lambda *a, b=branch: run(_Evaluation(self._items.size), b, *a) for branch in branches]
            return list(map(Value, lax.switch(index.array, apart, *arrays), many))
        cases = zip(*(run(self, branch, *arrays) for branch in branches), strict=True)
        return [Value(_chosen(index.array, case), True) for case in cases]


def _differs(closed: Any, given: Sequence[bool]) -> list[bool]:
    """Which results of a traced function differ from item to item if some of its arguments do."""
    jaxpr = getattr(closed, "jaxpr", closed)
    known: dict[Any, bool] = dict(zip(jaxpr.invars, given, strict=True))

    def read(atom: Any) -> bool:
        return not isinstance(atom, core.Literal) and known.get(atom, False)

    for equation in jaxpr.eqns:
        name, params, flags = equation.primitive.name, equation.params, [read(atom) for atom in equation.invars]
        if name in _CALLS:
            results = _differs(params.get("jaxpr") or params["call_jaxpr"], flags)
        elif name == "scan":
            results = _scan_differs(params, flags)
        elif name == "cond":
            results = _cond_differs(params["branches"], flags)
        else:
            results = [any(flags)] * len(equation.outvars)
        known.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _scan_differs(params: dict[str, Any], given: Sequence[bool]) -> list[bool]:
    """What is carried differs if it does at first, or comes to on the way."""
    first, count = params["num_consts"], params["num_carry"]
    flags = list(given)
    while True:
        found = _differs(params["jaxpr"], flags)
        carried = [before or after for before, after in zip(flags[first : first + count], found, strict=False)]
        if carried == flags[first : first + count]:
            return carried + found[count:]
        flags[first : first + count] = carried


def _cond_differs(branches: Sequence[Any], given: Sequence[bool]) -> list[bool]:
    found = [_differs(branch, given[1:]) for branch in branches]
    return [given[0] or any(each) for each in zip(*found, strict=True)]


def _bind(equation: Any, *arrays: Any) -> Any:
    """An operation carried out; functions with derivatives of their own keep them."""
    return equation.primitive.bind(*arrays, **equation.primitive.get_bind_params(equation.params))


def _values(equation: Any, result: Any, many: bool) -> list[Value]:
    return [Value(each, many) for each in (result if equation.primitive.multiple_results else [result])]


def _chosen(index: Any, cases: Sequence[Any]) -> Any:
    """For each item the case of its own index."""
    which = lax.broadcast_in_dim(index, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which.astype(bool) if len(cases) == 2 else which, *cases)
