"""What a kind of dispersion provides. A new kind is a module with a subclass, and an entry of `registry.Dispersion`.

Kinds do not see scenarios. Their methods get the nominal numbers as an array `nominal`, and values have the same shape:
that of the key, or one vector of the components of all keys if the kind is joint.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.errors import RpojaxError
from rpojax.value_types import OptionalKeys


@dataclass(frozen=True)
class ExtremeValue:
    """Value at the end of what a dispersion can assign, which the schema must allow for the key.

    Attributes:
        setting: of the dispersion, from which the value comes
        shown: what that setting says
        value: as the schema holds it, of the shape of the key
        whole: whether a run can have it, so that checks of all components together apply
    """

    setting: str
    shown: Any
    value: Any
    whole: bool


class DispersionKind(OptionalKeys):
    """Base class of the sections `[[dispersions]]`; a kind adds fields: its keys, its name `kind` and its settings.

    `common` says whether all servicers of a team have one error, None for what is usual for the keys.
    """

    if TYPE_CHECKING:
        kind: Any

    common: bool | None = None

    is_joint: ClassVar[bool] = False
    """Whether several keys, in a field `keys`, are assigned together."""
    takes_categories: ClassVar[bool] = False
    """Whether a key may be that of categories, such as kinds of fault, instead of quantities."""
    uses_nominal: ClassVar[bool] = True
    """Whether a value depends on the nominal numbers; otherwise setting these has no effect on runs."""

    @property
    @abstractmethod
    def key_texts(self) -> list[str]:
        """Keys that are assigned, as written in the scenario."""

    @property
    def name(self) -> str:
        """Unique name in a scenario: the key, or the keys joined by `+`."""
        return "+".join(self.key_texts)

    @abstractmethod
    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks the settings against the nominal numbers; `where` names the dispersion in an error.

        Raises:
            ScenarioError: naming the setting, what was found and what was expected.
        """

    def extreme_values(self, shape: tuple[int, ...]) -> list[ExtremeValue]:
        """Values that must be acceptable for a key of a shape; none if values are unbounded."""
        return []

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Ends (2, ...) between which nearly all values lie, 3 sigma for normal errors; the nominal if unknown."""
        return np.stack([nominal, nominal])

    @abstractmethod
    def coordinate_count(self, nominal: np.ndarray) -> int:
        """Dimension of the unit cube from which a value is drawn."""

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each number that `shown_numbers` gives, None where it is constant or unknown.

        `nominal` (n,) are the numbers of all keys, NaN where unknown.
        """
        return [None] * len(nominal)

    def shown_numbers(self, values: np.ndarray, nominal: np.ndarray) -> dict[str, np.ndarray] | None:
        """Numbers (runs,) that stand for drawn values (runs, n) in a report, by what follows the key in their names.

        None if these are the values themselves.
        """
        return None


class RandomKind(DispersionKind):
    """Base class of kinds that draw their values at random."""

    is_continuous: ClassVar[bool] = True
    """Whether a value is a continuous function of its coordinates in the unit cube."""
    is_separable: ClassVar[bool] = True
    """Whether each coordinate determines one component of a value, in order."""
    given_settings: ClassVar[tuple[str, ...]] = ()
    """Names of the numbers with which `draw` works as JAX arrays, too: compiled programs are given them, so that other
    values compile nothing anew."""

    def setting_arrays(self) -> dict[str, np.ndarray]:
        """The `given_settings`."""
        return {name: np.asarray(getattr(self, name), dtype=np.float64) for name in self.given_settings}

    def draw_with(self, settings: Mapping[str, Any], nominal: Array, source: RandomSource) -> Array:
        """Value of one run with other `setting_arrays`, as `draw`."""
        return self.model_copy(update=dict(settings)).draw(nominal, source)

    @abstractmethod
    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key; calls one method of `source`, once."""

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.ones(self.coordinate_count(nominal), dtype=bool)

    def coordinate_labels(self, components: Sequence[str]) -> list[str]:
        """Name of each coordinate, from the names of the components of a value."""
        return list(components)

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, inputs) per sigma of independent standard normal inputs.

        Raises:
            RpojaxError: values have no small deviations from a mean.
        """
        raise RpojaxError(
            f"dispersions: found kind {self.kind!r} for {self.name!r}, expected one with small deviations from a mean"
        )


class SingleKeyKind(RandomKind):
    """Base class of kinds that draw the value of one key; by default with one coordinate for each component."""

    key: str

    @property
    def key_texts(self) -> list[str]:
        """Keys that are assigned, as written in the scenario."""
        return [self.key]

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """Dimension of the unit cube from which a value is drawn."""
        return nominal.size
