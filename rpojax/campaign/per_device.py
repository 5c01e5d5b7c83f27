"""One traced function for several devices, each of which runs a program of its own."""

from collections.abc import Sequence
from typing import Any

import jax
from jax.sharding import SingleDeviceSharding

from rpojax.campaign.traces import Trace


def lowered(trace: Trace, arguments: Sequence[Any], devices: Sequence[Any], donate: tuple[int, ...] = ()) -> list[Any]:
    """The function lowered for each device, ready to be compiled there; `donate` numbers the arguments given up."""
    wanted = jax.jit(trace.call, donate_argnums=donate)
    return [wanted.lower(*jax.tree.map(lambda each, on=device: _shape(each, on), arguments)) for device in devices]


def _shape(array: Any, device: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, sharding=SingleDeviceSharding(device))
