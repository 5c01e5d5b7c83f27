"""`vmap` with the batch in the last axis of every intermediate array.

`jax.vmap` lets each operation choose the batch axis, and stacking moves it to the front: compiled loops then run over
the three components of a vector. Here they always run over the batch, whose elements lie side by side in memory.
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

from rpojax.batching.primitive_rules import RULES, Batch, BatchedValue

_CALL_PRIMITIVES = {"jit", "pjit", "closed_call", "core_call", "checkpoint", "remat2"}


def vmap(function: Callable[..., Any], in_axes: Any, out_axes: Any) -> Callable[..., Any]:
    """`function` mapped over the last axis of its arguments and results.

    Axes are given as to `jax.vmap`: -1 for arrays with a batch axis, None for arrays shared by the whole batch.
    Call it inside a compiled function: outside, all intermediate arrays are kept until it returns.

    Raises:
        ValueError: a result with `out_axes` None depends on the element of the batch.
    """

    def batched(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        axes = _leaf_axes(in_axes, args)
        operands = [BatchedValue(leaf, axis is not None) for leaf, axis in zip(leaves, axes, strict=True)]
        size = next(value.array.shape[-1] for value in operands if value.is_batched)
        elements = jax.tree.unflatten(tree, map(_element_shape, operands))
        traced, shape = jax.make_jaxpr(function, return_shape=True)(*elements)
        interpreter = _BatchedInterpreter(size)
        results = interpreter.evaluate(traced, operands)
        wanted = [axis is not None for axis in _leaf_axes(out_axes, shape)]
        if any(value.is_batched and not batched for value, batched in zip(results, wanted, strict=True)):
            raise ValueError("out_axes: found None for a result that differs from item to item, expected -1")
        arrays = interpreter.to_arrays(results, wanted)
        return jax.tree.unflatten(jax.tree.structure(shape), arrays)

    return batched


def _leaf_axes(axes: Any, tree: Any) -> list[int | None]:
    """The axis of each leaf of a tree, from axes given for whole branches of it."""
    flat: list[int | None] = []

    def repeat(axis: int | None, branch: Any) -> None:
        flat.extend([axis] * len(jax.tree.leaves(branch)))

    jax.tree.map(repeat, axes, tree, is_leaf=lambda node: node is None)
    return flat


def _element_shape(value: BatchedValue) -> jax.ShapeDtypeStruct:
    shape = jnp.shape(value.array)
    return jax.ShapeDtypeStruct(shape[:-1] if value.is_batched else shape, jnp.result_type(value.array))


class _BatchedInterpreter:
    """Evaluates the jaxpr of one element on a batch; an equation repeated on the same operands is evaluated once."""

    def __init__(self, size: int) -> None:
        self._batch = Batch(size)
        self._results: dict[Any, tuple[list[BatchedValue], list[BatchedValue]]] = {}

    def evaluate(self, closed: Any, arguments: Sequence[BatchedValue]) -> list[BatchedValue]:
        """Results of a jaxpr."""
        jaxpr, constants = getattr(closed, "jaxpr", closed), getattr(closed, "consts", ())
        shared = (BatchedValue(each, False) for each in constants)
        environment: dict[Any, BatchedValue] = dict(zip(jaxpr.constvars, shared, strict=True))
        environment.update(zip(jaxpr.invars, arguments, strict=True))

        def read(atom: Any) -> BatchedValue:
            if isinstance(atom, core.Literal):
                return BatchedValue(np.asarray(atom.val, dtype=atom.aval.dtype), False)  # pyright: ignore[reportAttributeAccessIssue]
            return environment[atom]

        for equation in jaxpr.eqns:
            scope = str(equation.source_info.name_stack)
            with jax.named_scope(scope) if scope else contextlib.nullcontext():
                results = self._evaluate_equation(equation, [read(atom) for atom in equation.invars])
            environment.update(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def to_arrays(self, values: Sequence[BatchedValue], batched: Sequence[bool]) -> list[Any]:
        """Arrays of values, with a batch axis where `batched` is true."""
        return [
            self._batch.broadcast(value) if is_batched else jnp.asarray(value.array)
            for value, is_batched in zip(values, batched, strict=True)
        ]

    def _evaluate_equation(self, equation: Any, operands: list[BatchedValue]) -> list[BatchedValue]:
        name, params = equation.primitive.name, equation.params
        if name in _CALL_PRIMITIVES:
            return self.evaluate(params.get("jaxpr") or params["call_jaxpr"], operands)
        if name == "scan":
            return self._scan(params, operands)
        if name == "cond":
            return self._cond(params["branches"], operands[0], operands[1:])
        if name not in RULES:  # others may have effects, or functions as parameters
            return self._bind_batched(equation, operands)
        key = (name, tuple(sorted(params.items())), *(value.identity for value in operands))
        if key not in self._results:
            # Operands are kept as long as their results, so that no later array gets the same id.
            self._results[key] = operands, self._bind_batched(equation, operands)
        return self._results[key][1]

    def _bind_batched(self, equation: Any, operands: list[BatchedValue]) -> list[BatchedValue]:
        name = equation.primitive.name
        if not any(value.is_batched for value in operands):
            return _wrap_outputs(equation, _bind(equation, *(value.array for value in operands)), False)
        rule = RULES.get(name)
        result = rule(equation, operands, self._batch) if rule else None
        if result is not None:
            return [BatchedValue(result, True)]
        axes = [-1 if value.is_batched else None for value in operands]
        mapped = jax.vmap(partial(_bind, equation), in_axes=axes, out_axes=-1)
        return _wrap_outputs(equation, mapped(*(value.array for value in operands)), True)

    def _scan(self, params: dict[str, Any], operands: list[BatchedValue]) -> list[BatchedValue]:
        first, last = params["num_consts"], params["num_consts"] + params["num_carry"]
        constants, carry, inputs = operands[:first], operands[first:last], operands[last:]
        inputs_batched = [value.is_batched for value in inputs]
        outputs_batched = _batched_scan_outputs(params, [value.is_batched for value in operands])
        carry_batched, stacked_batched = outputs_batched[: len(carry)], outputs_batched[len(carry) :]

        def body(state: list[Any], current: list[Any]) -> tuple[list[Any], list[Any]]:
            inner = _BatchedInterpreter(self._batch.size)
            arguments = *map(BatchedValue, state, carry_batched), *map(BatchedValue, current, inputs_batched)
            results = inner.evaluate(params["jaxpr"], [*constants, *arguments])
            count = len(carry_batched)
            return inner.to_arrays(results[:count], carry_batched), [value.array for value in results[count:]]

        initial, stacked_inputs = self.to_arrays(carry, carry_batched), [value.array for value in inputs]
        options = {"length": params["length"], "reverse": params["reverse"], "unroll": params["unroll"]}
        final, stacked = lax.scan(body, initial, stacked_inputs, **options)
        return [*map(BatchedValue, final, carry_batched), *map(BatchedValue, stacked, stacked_batched)]

    def _cond(self, branches: Sequence[Any], index: BatchedValue, operands: list[BatchedValue]) -> list[BatchedValue]:
        operands_batched = [value.is_batched for value in operands]
        outputs_batched = _batched_cond_outputs(branches, [index.is_batched, *operands_batched])

        def evaluate(interpreter: _BatchedInterpreter, branch: Any, *arrays: Any) -> list[Any]:
            results = interpreter.evaluate(branch, list(map(BatchedValue, arrays, operands_batched)))
            return interpreter.to_arrays(results, outputs_batched)

        arrays = [value.array for value in operands]
        if not index.is_batched:
            # Results of a branch are valid in that branch alone, and only in the current trace of it.
            separate = [
                lambda *a, b=branch: evaluate(_BatchedInterpreter(self._batch.size), b, *a) for branch in branches
            ]
            return list(map(BatchedValue, lax.switch(index.array, separate, *arrays), outputs_batched))
        cases = zip(*(evaluate(self, branch, *arrays) for branch in branches), strict=True)
        return [BatchedValue(_select_cases(index.array, case), True) for case in cases]


def _batched_outputs(closed: Any, batched: Sequence[bool]) -> list[bool]:
    """Which results of a jaxpr are batched if the arguments marked in `batched` are."""
    jaxpr = getattr(closed, "jaxpr", closed)
    environment: dict[Any, bool] = dict(zip(jaxpr.invars, batched, strict=True))

    def read(atom: Any) -> bool:
        return not isinstance(atom, core.Literal) and environment.get(atom, False)

    for equation in jaxpr.eqns:
        name, params, flags = equation.primitive.name, equation.params, [read(atom) for atom in equation.invars]
        if name in _CALL_PRIMITIVES:
            results = _batched_outputs(params.get("jaxpr") or params["call_jaxpr"], flags)
        elif name == "scan":
            results = _batched_scan_outputs(params, flags)
        elif name == "cond":
            results = _batched_cond_outputs(params["branches"], flags)
        else:
            results = [any(flags)] * len(equation.outvars)
        environment.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _batched_scan_outputs(params: dict[str, Any], batched: Sequence[bool]) -> list[bool]:
    """The same of a scan: its carry is batched if it is at the start or becomes so in any iteration."""
    first, count = params["num_consts"], params["num_carry"]
    flags = list(batched)
    while True:
        results = _batched_outputs(params["jaxpr"], flags)
        carry = [before or after for before, after in zip(flags[first : first + count], results, strict=False)]
        if carry == flags[first : first + count]:
            return carry + results[count:]
        flags[first : first + count] = carry


def _batched_cond_outputs(branches: Sequence[Any], batched: Sequence[bool]) -> list[bool]:
    """The same of a conditional with its index first."""
    results = [_batched_outputs(branch, batched[1:]) for branch in branches]
    return [batched[0] or any(each) for each in zip(*results, strict=True)]


def _bind(equation: Any, *arrays: Any) -> Any:
    """Result of an equation; functions with custom derivatives keep them."""
    return equation.primitive.bind(*arrays, **equation.primitive.get_bind_params(equation.params))


def _wrap_outputs(equation: Any, result: Any, is_batched: bool) -> list[BatchedValue]:
    return [BatchedValue(each, is_batched) for each in (result if equation.primitive.multiple_results else [result])]


def _select_cases(index: Any, cases: Sequence[Any]) -> Any:
    """For each element of the batch the case of its own index."""
    which = lax.broadcast_in_dim(index, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which.astype(bool) if len(cases) == 2 else which, *cases)
