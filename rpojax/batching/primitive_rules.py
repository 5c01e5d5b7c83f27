"""What an operation on one item becomes for many of them along the last axis; the others are left to `jax.vmap`."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax


class Value(NamedTuple):
    """An array, and whether its last axis is that of the items; else they have it in common."""

    array: Any
    many: bool

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one item."""
        return jnp.shape(self.array)[: -1 if self.many else None]

    @property
    def identity(self) -> Any:
        """Alike only for the same numbers of the same type, as long as both values exist."""
        array = self.array
        own = (str(array.dtype), array.shape, array.tobytes()) if isinstance(array, np.ndarray) else id(array)
        return own, self.many


class Items:
    """The items of a batch, and what they have in common, once it has been given to each of them.

    Attributes:
        size: how many there are
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._spread: dict[Any, tuple[Value, Any]] = {}

    def spread(self, value: Value, shape: tuple[int, ...] = ()) -> Any:
        """The array with an axis of items; a scalar, and only that, with `shape` before it."""
        own = value.shape
        if value.many and (own or not shape):
            return value.array
        key = value.identity, own or shape
        if key not in self._spread:
            wanted = (*(own or shape), self.size)
            places = (len(shape),) if value.many else range(len(own))
            self._spread[key] = value, lax.broadcast_in_dim(value.array, wanted, places)
        return self._spread[key][1]


Rule = Callable[[Any, list[Value], Items], Any]
"""From the operation, its arguments and the items to its result, None where it does not know."""


def _elementwise(equation: Any, given: list[Value], items: Items) -> Any:
    # An operation may take a scalar beside an array.
    shape = max((value.shape for value in given), key=len)
    return equation.primitive.bind(*(items.spread(value, shape) for value in given), **equation.params)


def _bitcast(equation: Any, given: list[Value], items: Items) -> Any:
    # Numbers of another width get an axis of their own, after that of the items.
    same = given[0].array.dtype.itemsize == np.dtype(equation.params["new_dtype"]).itemsize
    return _elementwise(equation, given, items) if same else None


def _select(equation: Any, given: list[Value], items: Items) -> Any:
    which, *cases = given
    if not which.many and jnp.ndim(which.array) == 0:
        return lax.select_n(which.array, *map(items.spread, cases))
    return _elementwise(equation, given, items)


def _slice(equation: Any, given: list[Value], items: Items) -> Any:
    params = equation.params
    strides = None if params["strides"] is None else (*params["strides"], 1)
    return lax.slice(given[0].array, (*params["start_indices"], 0), (*params["limit_indices"], items.size), strides)


def _dynamic_slice(equation: Any, given: list[Value], items: Items) -> Any:
    array, *starts = given
    if not array.many or any(start.many for start in starts):
        return None
    first = jnp.zeros((), dtype=jnp.result_type(starts[0].array))
    return lax.dynamic_slice(
        array.array, (*(start.array for start in starts), first), (*equation.params["slice_sizes"], items.size)
    )


def _gather(equation: Any, given: list[Value], items: Items) -> Any:
    array, places = given
    if not array.many or places.many:
        return None
    params, numbers = dict(equation.params), equation.params["dimension_numbers"]
    params["dimension_numbers"] = numbers._replace(
        offset_dims=(*numbers.offset_dims, len(equation.outvars[0].aval.shape))
    )
    params["slice_sizes"] = (*params["slice_sizes"], items.size)
    return equation.primitive.bind(array.array, places.array, **params)


def _squeeze(equation: Any, given: list[Value], _: Items) -> Any:
    return lax.squeeze(given[0].array, equation.params["dimensions"])


def _expand(equation: Any, given: list[Value], items: Items) -> Any:
    shape = (*equation.params["shape"], items.size)
    places = (*equation.params["broadcast_dimensions"], len(shape) - 1)
    return lax.broadcast_in_dim(given[0].array, shape, places)


def _concatenate(equation: Any, given: list[Value], items: Items) -> Any:
    return lax.concatenate(list(map(items.spread, given)), equation.params["dimension"])


def _stack(equation: Any, given: list[Value], items: Items) -> Any:
    return jnp.stack(list(map(items.spread, given)), axis=equation.params["axis"])


def _pad(equation: Any, given: list[Value], items: Items) -> Any:
    array, filling = given
    if filling.many:
        return None
    return lax.pad(items.spread(array), filling.array, (*equation.params["padding_config"], (0, 0, 0)))


def _transpose(equation: Any, given: list[Value], _: Items) -> Any:
    order = equation.params["permutation"]
    return lax.transpose(given[0].array, (*order, len(order)))


def _reshape(equation: Any, given: list[Value], items: Items) -> Any:
    return lax.reshape(given[0].array, (*equation.params["new_sizes"], items.size))


def _as_it_is(equation: Any, given: list[Value], _: Items) -> Any:
    """Reductions and the like over axes that are counted from the front."""
    return equation.primitive.bind(given[0].array, **equation.params)


_ELEMENTWISE = (
    "abs acos add and asin atan atan2 cbrt ceil clamp convert_element_type copy cos cosh div "
    "eq erf erf_inv erfc exp exp2 expm1 floor ge gt integer_pow is_finite le log log1p logistic lt max min mul ne "
    "neg nextafter not or pow rem round rsqrt shift_left shift_right_arithmetic shift_right_logical sign sin sinh "
    "sqrt square stop_gradient sub tan tanh xor"
)

_REDUCTIONS = "argmax argmin reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum"

RULES: dict[str, Rule] = {
    **dict.fromkeys(_ELEMENTWISE.split(), _elementwise),
    **dict.fromkeys(_REDUCTIONS.split(), _as_it_is),
    "bitcast_convert_type": _bitcast,
    "broadcast_in_dim": _expand,
    "concatenate": _concatenate,
    "dynamic_slice": _dynamic_slice,
    "gather": _gather,
    "pad": _pad,
    "reshape": _reshape,
    "select_n": _select,
    "slice": _slice,
    "squeeze": _squeeze,
    "stack": _stack,
    "transpose": _transpose,
}
"""Rules by name of the operation."""
