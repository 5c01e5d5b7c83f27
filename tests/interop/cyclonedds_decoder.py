"""Independent decoder of a bag's messages: cyclonedds classes made from the message definitions."""

from functools import cache
from importlib import import_module
from typing import Any

from cyclonedds.idl import make_idl_struct, types

from rpojax.interop.ros2.message_types import typestore

_BASES = {"bool": bool, "string": str, "byte": types.uint8, "char": types.uint8, "octet": types.uint8}


@cache
def message_class(name: str) -> Any:
    """Cyclonedds class of a message type."""
    fields = {field: _type(kind) for field, kind in typestore().fielddefs[name][1]}
    return make_idl_struct(name.rpartition("/")[2] + "_", name.replace("/", "."), fields)


def _type(descriptor: Any) -> Any:
    kinds = import_module("rosbags.interfaces").Nodetype
    kind, what = descriptor
    if kind == kinds.NAME:
        return message_class(what)
    if kind == kinds.BASE:
        return _BASES.get(what[0]) or getattr(types, what[0])
    element, size = what
    return types.array[_type(element), size] if kind == kinds.ARRAY else types.sequence[_type(element)]
