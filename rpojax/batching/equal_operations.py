"""Sharing of equal operations: one that is repeated on the same operands is evaluated once."""

from collections.abc import Callable
from typing import Any

from rpojax.batching.batched_value import BatchedValue
from rpojax.batching.jax_programs import Operation


class EqualOperations:
    """Results of the operations evaluated so far, valid in one trace: in a loop or a branch there is another one.

    XLA finds repeated operations too, but only after most of its passes.
    """

    def __init__(self) -> None:
        self._results: dict[Any, tuple[list[BatchedValue], list[BatchedValue]]] = {}

    def evaluate_once(
        self, operation: Operation, operands: list[BatchedValue], evaluate: Callable[[], list[BatchedValue]]
    ) -> list[BatchedValue]:
        """Results of an operation: those of an equal one before, otherwise of `evaluate`.

        An operation that may have effects, or functions as parameters, is evaluated every time.
        """
        sharing_key = operation.sharing_key
        if sharing_key is None:
            return evaluate()
        key = (sharing_key, *(value.identity for value in operands))
        if key not in self._results:
            # Operands are kept as long as their results, so that no later array gets the same id.
            self._results[key] = operands, evaluate()
        return self._results[key][1]
