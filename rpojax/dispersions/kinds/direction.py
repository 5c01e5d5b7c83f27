"""Dispersion over all directions."""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
import scipy

from rpojax.dispersions.kinds.component_count_checks import check_component_count
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource

_COORDINATES = ("height", "azimuth")


class RandomDirection(SingleKeyKind):
    """Unit vector uniform on the sphere."""

    kind: Literal["direction"]

    is_separable: ClassVar[bool] = False
    uses_nominal: ClassVar[bool] = False

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the key is that of a vector."""
        check_component_count(where, self.kind, nominal, 3)

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """Two: along the third axis, and azimuth about it."""
        return len(_COORDINATES)

    def coordinate_labels(self, components: Sequence[str]) -> list[str]:
        """Name of each coordinate."""
        return [f"{self.name} ({coordinate})" for coordinate in _COORDINATES]

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run."""
        return source.direction()

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component."""
        # Archimedes: each coordinate of a point on the sphere is uniform.
        return [scipy.stats.uniform(-1.0, 2.0)] * len(nominal)
