"""Dispersion over all attitudes."""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
import scipy

from rpojax.dispersions.kinds.component_count_checks import check_component_count
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource

_COORDINATES = ("share", "first angle", "second angle")


class RandomAttitude(SingleKeyKind):
    """Unit quaternion uniform over all attitudes."""

    kind: Literal["attitude"]

    is_separable: ClassVar[bool] = False
    uses_nominal: ClassVar[bool] = False

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the key is that of a quaternion."""
        check_component_count(where, self.kind, nominal, 4)

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """Three: the share of two components in the norm, and the angles of both pairs."""
        return len(_COORDINATES)

    def coordinate_labels(self, components: Sequence[str]) -> list[str]:
        """Name of each coordinate."""
        return [f"{self.name} ({coordinate})" for coordinate in _COORDINATES]

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run."""
        return source.attitude()

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component."""
        # On the sphere in four dimensions the density of a coordinate x is proportional to sqrt(1 - x^2).
        return [scipy.stats.semicircular()] * len(nominal)
