"""Evaluation of the program of one element on a batch in the last axis of every array."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from rpojax.batching import jax_programs
from rpojax.batching.batched_value import Batch, BatchedValue
from rpojax.batching.equal_operations import EqualOperations
from rpojax.batching.jax_programs import Form, Operation, Program, Scan
from rpojax.batching.primitive_rules import RULES


class BatchedInterpreter:
    """Evaluates programs of one element on a batch, and equal operations once.

    Args:
        size: number of elements of the batch
    """

    def __init__(self, size: int) -> None:
        self._batch = Batch(size)
        self._equal = EqualOperations()

    def evaluate(self, program: Program, arguments: Sequence[BatchedValue]) -> list[BatchedValue]:
        """Results of a program.

        Raises:
            BatchingError: an operation has functions as parameters whose batching is unknown.
        """
        environment = {variable: BatchedValue(array, False) for variable, array in program.constants}
        environment.update(zip(program.inputs, arguments, strict=True))

        def read(atom: Any) -> BatchedValue:
            return BatchedValue(atom, False) if isinstance(atom, np.ndarray) else environment[atom]

        for operation in program.operations:
            with operation.named_scope(), operation.settings():
                results = self._evaluate_operation(operation, list(map(read, operation.operands)))
            environment.update(zip(operation.results, results, strict=True))
        return list(map(read, program.outputs))

    def to_arrays(self, values: Sequence[BatchedValue], batched: Sequence[bool]) -> list[Any]:
        """Arrays of values, with a batch axis where `batched` is true."""
        return [
            self._batch.broadcast(value) if is_batched else jnp.asarray(value.array)
            for value, is_batched in zip(values, batched, strict=True)
        ]

    def _evaluate_operation(self, operation: Operation, operands: list[BatchedValue]) -> list[BatchedValue]:
        match operation.form:
            case Form.CALL:
                return self.evaluate(operation.called_program, operands)
            case Form.SCAN:
                return self._scan(operation.scan, operands)
            case Form.CONDITIONAL:
                return self._conditional(operation.branches, operands[0], operands[1:])
            case Form.ANY_OF_BATCH:
                (flag,) = operands
                found = jnp.any(flag.array, axis=-1) if flag.is_batched else flag.array
                return [BatchedValue(jax_programs.any_of_batch(found), False)]
            case _:
                return self._equal.evaluate_once(operation, operands, lambda: self._batched(operation, operands))

    def _batched(self, operation: Operation, operands: list[BatchedValue]) -> list[BatchedValue]:
        if not any(value.is_batched for value in operands):
            return [BatchedValue(each, False) for each in operation.evaluate(*(value.array for value in operands))]
        rule = RULES.get(operation.form)
        results = rule(operation, operands, self._batch) if rule else None
        if results is None:
            operation.check_functions()
            axes = [-1 if value.is_batched else None for value in operands]
            mapped = jax.vmap(operation.evaluate, in_axes=axes, out_axes=-1)
            results = mapped(*(value.array for value in operands))
        return [BatchedValue(each, True) for each in results]

    def _scan(self, scan: Scan, operands: list[BatchedValue]) -> list[BatchedValue]:
        constants, carry, inputs = operands[scan.constants], operands[scan.carry], operands[scan.carry.stop :]
        inputs_batched = [value.is_batched for value in inputs]
        outputs_batched = _batched_scan_outputs(scan, [value.is_batched for value in operands])
        carry_batched, stacked_batched = outputs_batched[: len(carry)], outputs_batched[len(carry) :]

        def body(state: list[Any], current: list[Any]) -> tuple[list[Any], list[Any]]:
            inner = BatchedInterpreter(self._batch.size)
            arguments = *map(BatchedValue, state, carry_batched), *map(BatchedValue, current, inputs_batched)
            arrays = inner.to_arrays(inner.evaluate(scan.body, [*constants, *arguments]), outputs_batched)
            return arrays[: len(carry)], arrays[len(carry) :]

        initial, stacked_inputs = self.to_arrays(carry, carry_batched), [value.array for value in inputs]
        final, stacked = lax.scan(body, initial, stacked_inputs, **scan.options)
        return [*map(BatchedValue, final, carry_batched), *map(BatchedValue, stacked, stacked_batched)]

    def _conditional(
        self, branches: Sequence[Program], index: BatchedValue, operands: list[BatchedValue]
    ) -> list[BatchedValue]:
        operands_batched = [value.is_batched for value in operands]
        outputs_batched = _batched_conditional_outputs(branches, [index.is_batched, *operands_batched])

        def evaluate(interpreter: BatchedInterpreter, branch: Program, *arrays: Any) -> list[Any]:
            results = interpreter.evaluate(branch, list(map(BatchedValue, arrays, operands_batched)))
            return interpreter.to_arrays(results, outputs_batched)

        arrays = [value.array for value in operands]
        if not index.is_batched:
            # Results of a branch are valid in that branch alone, and only in the current trace of it.
            separate = [
                lambda *a, b=branch: evaluate(BatchedInterpreter(self._batch.size), b, *a) for branch in branches
            ]
            return list(map(BatchedValue, lax.switch(index.array, separate, *arrays), outputs_batched))
        cases = zip(*(evaluate(self, branch, *arrays) for branch in branches), strict=True)
        return [BatchedValue(_select_cases(index.array, case), True) for case in cases]


def _batched_outputs(program: Program, batched: Sequence[bool]) -> list[bool]:
    """Which results of a program are batched if the arguments marked in `batched` are."""
    environment: dict[Any, bool] = dict(zip(program.inputs, batched, strict=True))

    def read(atom: Any) -> bool:
        return not isinstance(atom, np.ndarray) and environment.get(atom, False)

    for operation in program.operations:
        flags = list(map(read, operation.operands))
        match operation.form:
            case Form.CALL:
                results = _batched_outputs(operation.called_program, flags)
            case Form.SCAN:
                results = _batched_scan_outputs(operation.scan, flags)
            case Form.CONDITIONAL:
                results = _batched_conditional_outputs(operation.branches, flags)
            case Form.ANY_OF_BATCH:
                results = [False]
            case _:
                results = [any(flags)] * len(operation.results)
        environment.update(zip(operation.results, results, strict=True))
    return list(map(read, program.outputs))


def _batched_scan_outputs(scan: Scan, batched: Sequence[bool]) -> list[bool]:
    """The same of a scan: its carry is batched if it is at the start or becomes so in any iteration."""
    flags = list(batched)
    count = len(flags[scan.carry])
    while True:
        results = _batched_outputs(scan.body, flags)
        carry = [before or after for before, after in zip(flags[scan.carry], results[:count], strict=True)]
        if carry == flags[scan.carry]:
            return carry + results[count:]
        flags[scan.carry] = carry


def _batched_conditional_outputs(branches: Sequence[Program], batched: Sequence[bool]) -> list[bool]:
    """The same of a conditional with its index first."""
    results = [_batched_outputs(branch, batched[1:]) for branch in branches]
    return [batched[0] or any(each) for each in zip(*results, strict=True)]


def _select_cases(index: Any, cases: Sequence[Any]) -> Any:
    """For each element of the batch the case of its own index."""
    which = lax.broadcast_in_dim(index, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which.astype(bool) if len(cases) == 2 else which, *cases)
