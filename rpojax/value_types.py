"""Field types of sections of a scenario: bounded numbers, vectors, inertias, dates; and the base class of sections."""

import functools
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Any, SupportsIndex

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    create_model,
    model_serializer,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from rpojax.time_scales import instant

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
NonNegativeVector = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]


_MIN_NORM = 1e-6
"""Least norm of a direction or quaternion; the unit vector of a shorter one would be rounding noise."""


def _check_nonzero(value: list[float]) -> list[float]:
    if math.hypot(*value) < _MIN_NORM:
        raise ValueError(f"expected a vector that is not zero, at least {_MIN_NORM:g} long")
    return value


def _check_inertia(value: list[list[float]]) -> list[list[float]]:
    matrix = np.array(value)
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ValueError("expected a symmetric matrix")
    principal = np.linalg.eigvalsh(matrix)
    if principal[0] <= 0.0:
        raise ValueError("expected a positive definite matrix")
    if principal[2] > (principal[0] + principal[1]) * (1.0 + 1e-9):
        raise ValueError("expected principal moments of a real body: the largest at most the sum of the others")
    return value


def _check_axes(value: list[list[float]]) -> list[list[float]]:
    rows = np.array(value)
    if not np.allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-6):
        raise ValueError("expected unit vectors, one a row")
    if abs(np.linalg.det(rows)) < 1e-3:
        raise ValueError("expected three axes that span space")
    return value


def _check_covariance(value: list[list[float]]) -> list[list[float]]:
    if any(len(row) != len(value) for row in value):
        raise ValueError("expected as many columns as rows")
    matrix = np.array(value)
    sigma = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    # Scaled to unit variances, because the units of the components differ by orders of magnitude.
    scale = np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
    correlation = matrix / scale
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=1e-9):
        raise ValueError("expected a symmetric matrix")
    if np.any(np.diag(matrix) < 0.0) or np.linalg.eigvalsh(correlation)[0] < -1e-9:
        raise ValueError("expected a positive semidefinite matrix")
    return value


def _date_to_text(value: Any) -> Any:
    """Text of an unquoted TOML date."""
    return value.isoformat() if isinstance(value, date) else value


def _check_epoch(value: str) -> str:
    try:
        seconds = epoch_seconds(value)
    except ValueError as error:
        raise ValueError(f"expected {error}") from None
    if seconds > _EPHEMERIS_SPAN_S:
        raise ValueError("expected a date from 1972 to 2050, for which UTC, Sun and Moon are known well")
    return value


_EPHEMERIS_SPAN_S = 50.0 * 365.25 * 86400.0


def epoch_seconds(utc: str) -> float:
    """Terrestrial time since 2000-01-01 12:00 [s] of a date and time in UTC.

    Raises:
        ValueError: saying what is expected.
    """
    return instant(utc).terrestrial_s


Epoch = Annotated[str, BeforeValidator(_date_to_text), AfterValidator(_check_epoch)]
Direction = Annotated[Vector, AfterValidator(_check_nonzero)]
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4), AfterValidator(_check_nonzero)]
Matrix3 = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Inertia = Annotated[Matrix3, AfterValidator(_check_inertia)]
Axes = Annotated[Matrix3, AfterValidator(_check_axes)]
Covariance = Annotated[list[list[Finite]], Field(min_length=1, max_length=64), AfterValidator(_check_covariance)]
Hull = Annotated[list[Vector], Field(min_length=4, max_length=64)]


def whole_number(value: object) -> int | None:
    """An integer of Python or NumPy as one of Python; None for everything else, truth values included."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, SupportsIndex):
        return None
    try:
        return operator.index(value)
    except TypeError:  # an array of one dimension or more
        return None


class Section(BaseModel):
    """Base class of all sections: unknown keys are refused, types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class OptionalKeys(Section):
    """Base class of sections with keys that may be left out: those that are None are not in the section's table."""

    @model_serializer(mode="wrap")
    def _leave_out_absent(self, serialise: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        return {key: value for key, value in serialise(self).items() if value is not None}


@dataclass(frozen=True)
class ChangesOf:
    """Mark of a field that holds some keys of a section, each of the form that the section demands.

    Attributes:
        section: the whole section
        nested: its sections of which also only some keys are given, by their key
        tables: keys of tables that are checked only once they are merged
        without: keys that cannot be given
    """

    section: type[Section]
    nested: tuple[tuple[str, type[Section]], ...] = ()
    tables: tuple[str, ...] = ()
    without: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema of the section with all keys optional."""
        return handler.generate_schema(_optional_keys(self))


@functools.cache
def _optional_keys(changes: ChangesOf) -> type[OptionalKeys]:
    forms = {name: _form(field) for name, field in changes.section.model_fields.items() if name not in changes.without}
    forms |= {name: _optional_keys(ChangesOf(section)) for name, section in changes.nested}
    forms |= dict.fromkeys(changes.tables, dict[str, Any])
    fields: dict[str, Any] = {name: (form | None, None) for name, form in forms.items()}
    name, summary = changes.section.__name__, changes.section.__doc__ or ""
    return create_model(f"{name}Changes", __base__=OptionalKeys, __doc__=f"Keys that differ: {summary}", **fields)


def _form(field: FieldInfo) -> Any:
    """Type of a field with its limits and checks."""
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
