"""Schema of the `[[dispersions]]` of a scenario: one section for each kind of distribution."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rpojax.field_types import Covariance, Finite, NonNegative, Positive, Section
from rpojax.physics.plant_options import FaultKind


class Normal(Section):
    """Nominal value plus a normal error, per component."""

    key: str
    kind: Literal["normal"]
    sigma: NonNegative | list[NonNegative]


class TruncatedNormal(Section):
    """Nominal value plus a normal error truncated at `limit_sigmas`, per component."""

    key: str
    kind: Literal["truncated_normal"]
    sigma: NonNegative | list[NonNegative]
    limit_sigmas: Positive


class Uniform(Section):
    """Uniform between two bounds, per component."""

    key: str
    kind: Literal["uniform"]
    low: Finite
    high: Finite

    @model_validator(mode="after")
    def _check_order(self) -> "Uniform":
        if self.low > self.high:
            raise ValueError("expected low at most high")
        return self


class LogNormal(Section):
    """Nominal value times the exponential of a normal number, per component."""

    key: str
    kind: Literal["log_normal"]
    sigma: NonNegative | list[NonNegative]


class Choice(Section):
    """One of several values with equal probability."""

    key: str
    kind: Literal["choice"]
    values: Annotated[list[Finite] | list[list[Finite]] | list[FaultKind], Field(min_length=1)]


class RandomDirection(Section):
    """Unit vector uniform on the sphere."""

    key: str
    kind: Literal["direction"]


class RandomAttitude(Section):
    """Unit quaternion uniform over all attitudes."""

    key: str
    kind: Literal["attitude"]


class SmallRotation(Section):
    """Nominal quaternion rotated by a normal rotation vector."""

    key: str
    kind: Literal["small_rotation"]
    sigma_deg: NonNegative | list[NonNegative]


class CorrelatedNormal(Section):
    """Nominal values plus normal errors with a covariance; the key of a vector stands for its components."""

    keys: Annotated[list[str], Field(min_length=1, max_length=64)]
    kind: Literal["correlated_normal"]
    covariance: Covariance


class Term(Section):
    """Multiple of another value of the same run."""

    key: str
    factor: Finite


class Derived(Section):
    """Linear function of other values of the same run, dispersed or nominal: an offset plus a sum of terms."""

    key: str
    kind: Literal["derived"]
    offset: Finite | list[Finite]
    terms: Annotated[list[Term], Field(min_length=1, max_length=64)]


Dispersion = Annotated[
    Normal
    | TruncatedNormal
    | Uniform
    | LogNormal
    | Choice
    | RandomDirection
    | RandomAttitude
    | SmallRotation
    | CorrelatedNormal
    | Derived,
    Field(discriminator="kind"),
]
