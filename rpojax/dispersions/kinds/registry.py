"""All kinds of dispersion.

The parts of SciPy are loaded at their first use.
"""

from collections.abc import Mapping
from typing import Annotated, Any, get_args

from pydantic import Field, TypeAdapter, ValidationError

from rpojax.dispersions.kinds.attitude import RandomAttitude
from rpojax.dispersions.kinds.choice import Choice
from rpojax.dispersions.kinds.correlated_normal import CorrelatedNormal
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.direction import RandomDirection
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind
from rpojax.dispersions.kinds.log_normal import LogNormal
from rpojax.dispersions.kinds.normal import Normal
from rpojax.dispersions.kinds.small_rotation import SmallRotation
from rpojax.dispersions.kinds.truncated_normal import TruncatedNormal
from rpojax.dispersions.kinds.uniform import Uniform

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


def kind_class(kind: object) -> type[DispersionKind] | None:
    """Class of a kind of dispersion by its name, None if there is no such kind."""
    classes = get_args(get_args(Dispersion)[0])
    return next((each for each in classes if get_args(each.model_fields["kind"].annotation)[0] == kind), None)


def recorded_dispersion(table: Mapping[str, Any]) -> DispersionKind | None:
    """Dispersion of a recorded scenario from its table, None if this version does not know it."""
    try:
        return TypeAdapter(Dispersion).validate_python(table)
    except ValidationError:
        return None
