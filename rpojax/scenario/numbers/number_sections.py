"""Sections of a scenario whose keys are the declared numbers of records."""

from dataclasses import MISSING
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field, create_model

from rpojax.core.declared_numbers import Number, declared_numbers
from rpojax.scenario.numbers import key_units
from rpojax.value_types import OptionalKeys, Section


class NumberSection(Section):
    """Section of declared numbers, beside which there may be static settings."""

    first: ClassVar[tuple[str, ...]] = ()
    """Begins of the keys that come first in a file, in their order."""

    @classmethod
    def __pydantic_init_subclass__(cls, **settings: Any) -> None:
        """Puts the keys in the order of files."""
        super().__pydantic_init_subclass__(**settings)

        def rank(key: str) -> int:
            return next((place for place, begin in enumerate(cls.first) if key.startswith(begin)), len(cls.first))

        ordered = {key: cls.model_fields[key] for key in sorted(cls.model_fields, key=rank)}
        if list(ordered) != list(cls.model_fields):
            cls.model_fields.clear()
            cls.model_fields.update(ordered)
            cls.model_rebuild(force=True)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


def section_of(
    record: type, *others: type, name: str = "", first: tuple[str, ...] = (), optional: bool = False
) -> type[NumberSection]:
    """Base class of a section with a key for each declared number of a record.

    Args:
        record: the record that the section becomes
        others: records with numbers whose declared keys name this section
        name: of this section, needed if declarations name it
        first: begins of the keys that come first in a file, in their order; the section's class may declare them
        optional: whether keys may be left out without a default
    """
    fields: dict[str, Any] = {}
    for each in (record, *others):
        for field, (key, number) in declared_numbers(each).items():
            section, _, key = key.rpartition(".")
            if section != name and (section or each is not record):
                continue
            if not number.key and key_units.split_unit(key)[0] != field:
                raise TypeError(f"{each.__name__}.{field}: found the unit {number.unit!r}, expected a known one")
            default = ... if number.default is MISSING else number.default
            fields[key] = (Annotated[number.form, number], Field(default, description=number.meaning))
    bases: Any = (NumberSection, OptionalKeys) if optional else NumberSection
    made: Any = create_model(f"{record.__name__}Numbers", __base__=bases, **fields)
    made.first = first
    return made


def is_variable(section: type[Section], key: str) -> bool:
    """Whether a key of a section is a declared number that may be dispersed and differentiated."""
    return any(isinstance(each, Number) and each.varies for each in section.model_fields[key].metadata)
