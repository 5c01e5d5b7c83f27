"""Records of declared numbers from the tables of a scenario, in SI and radians."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from rpojax.core.declared_numbers import declared_numbers
from rpojax.physics import equipment_faults
from rpojax.scenario.numbers import key_units


def section_record(cls: type, table: Mapping[str, Any], **others: Any) -> Any:
    """Record of one section; its keys that are no declared numbers are static settings and are skipped."""
    return record_of(cls, {"": table}, "", **others)


def record_of(cls: type, tables: Mapping[str, Any], section: str, **others: Any) -> Any:
    """Record of the numbers of a section, or of those that its declarations name, and of other fields."""
    for name, (key, _) in declared_numbers(cls).items():
        named, _, key = key.rpartition(".")
        table = tables[named or section]
        if key in table:
            others[name] = array(equipment_faults.kind_code(table[key]), key_units.split_unit(key)[1])
    return cls(**others)


def array(value: Any, factor: float = 1.0) -> Array:
    """A number or array in SI, without JAX, of which each operation would compile a program at the first start."""
    return jax.device_put(np.asarray(value, dtype=np.float64) * factor)
