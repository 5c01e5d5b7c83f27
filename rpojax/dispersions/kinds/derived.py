"""Values derived from other values of the same run."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from rpojax.dispersions.kinds.component_count_checks import check_one_or_each
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind
from rpojax.errors import ScenarioError
from rpojax.value_types import Finite, Section


class Term(Section):
    """Multiple of another value of the same run."""

    key: str
    factor: Finite


class Derived(DispersionKind):
    """Linear function of other values of the same run, dispersed or nominal: an offset plus a sum of terms."""

    key: str
    kind: Literal["derived"]
    offset: Finite | list[Finite]
    terms: Annotated[list[Term], Field(min_length=1, max_length=64)]

    uses_nominal: ClassVar[bool] = False

    @property
    def key_texts(self) -> list[str]:
        """Keys that are assigned, as written in the scenario."""
        return [self.key]

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the key is that of a number or a vector, and that `offset` fits it."""
        if nominal.ndim > 1:
            raise ScenarioError(f"{where}.key", self.key, "the key of a number or a vector")
        check_one_or_each(f"{where}.offset", self.offset, nominal.shape)

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """None: nothing is drawn."""
        return 0

    def value(self, shape: tuple[int, ...], inputs: Sequence[Any]) -> Any:
        """Value of a shape, from those of the keys of the terms, all NumPy or all JAX arrays."""
        total = np.broadcast_to(np.asarray(self.offset, dtype=np.float64), shape)
        for term, number in zip(self.terms, inputs, strict=True):
            total = total + term.factor * number
        return total

    def change(self, size: int, changes: Sequence[np.ndarray | None]) -> np.ndarray | None:
        """Change (size, inputs) of the value per sigma of the inputs of a source of deviations; None without effect.

        `changes` (1 or size, inputs) are those of the keys of the terms, None where the source has no effect.
        """
        parts = [
            np.broadcast_to(term.factor * change, (size, change.shape[1]))
            for term, change in zip(self.terms, changes, strict=True)
            if change is not None
        ]
        return sum(parts[1:], parts[0]) if parts else None
