"""Dispersion over a list of values."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rpojax.dispersions.kinds.dispersion_kind import ExtremeValue, SingleKeyKind
from rpojax.dispersions.listed_values import check_listed_values, listed_ends, listed_numbers
from rpojax.dispersions.marginal_distribution import Distribution, discrete_distribution
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.physics.plant_options import FaultKind
from rpojax.value_types import Finite


class Choice(SingleKeyKind):
    """One of several values with equal probability."""

    kind: Literal["choice"]
    values: Annotated[list[Finite] | list[list[Finite]] | list[FaultKind], Field(min_length=1)]

    takes_categories: ClassVar[bool] = True
    uses_nominal: ClassVar[bool] = False
    is_continuous: ClassVar[bool] = False

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the values fit the key."""
        check_listed_values(f"{where}.values", self.key, self.values, nominal.shape)

    def extreme_values(self, shape: tuple[int, ...]) -> list[ExtremeValue]:
        """All values."""
        return [ExtremeValue("values", value, value, whole=True) for value in self.values]

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """One, whose equal intervals select the values."""
        return 1

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key."""
        import jax.numpy as jnp

        return jnp.asarray(listed_numbers(self.values))[source.integer(len(self.values))]

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Least and greatest of the values, by component; categories have none."""
        return listed_ends(self.values, nominal)

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component."""
        columns = listed_numbers(self.values).reshape(len(self.values), -1).T
        return [discrete_distribution(column) for column in columns]
