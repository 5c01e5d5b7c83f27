"""Metrics of a user's own functions: of channels of a tick with a reduction over time, or of a whole run; free of JAX.

A function declares by name the channels that it needs. One marked with `metric` gets those of a tick and is reduced
over time, also during the simulation and with derivatives; one that is not marked gets the whole record of a run.
"""

import difflib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Final, TypeVar, get_args

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.errors import RpojaxError
from rpojax.metrics.metric_definition import Floats, Metric, Reduction, RunTiming, WeightedValue, Window

MetricFunction = Callable[..., Any]
"""From channels by name to a number."""
Function = TypeVar("Function", bound=MetricFunction)

_MARK: Final = "__rpojax_metric__"
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,59}")
_SMALLEST_BATCH: Final = 1024
"""Ticks that are evaluated at once at least, so that few sizes are compiled."""


@dataclass(frozen=True)
class MetricSettings:
    """What `metric` says of a function.

    Attributes:
        reduction: over time; None for a function of whole runs
        window: ticks that count
        unit: as text; None for that of the name's suffix
        title: for people; None for the name in words
        low_is_bad: low values are the worse ones
        differentiable: its derivative is useful
    """

    reduction: Reduction | None = None
    window: Window = "all"
    unit: str | None = None
    title: str | None = None
    low_is_bad: bool = False
    differentiable: bool = True


def metric(
    reduction: Reduction | None = None,
    *,
    window: Window = "all",
    unit: str | None = None,
    title: str | None = None,
    low_is_bad: bool = False,
    differentiable: bool = True,
) -> Callable[[Function], Function]:
    """Marks a function of the channels of one tick as a metric with a reduction over time.

    Args:
        reduction: `mean`, `rms`, `sum`, `min`, `max` or `end`; None for a function of whole runs
        window: `all` ticks, the `late` ones from 1000 s on, or those of the `last` 1000 s
        unit: as text, by default that of the name's suffix
        title: for people, by default the name in words
        low_is_bad: low values are the worse ones
        differentiable: its derivative is useful, as for a smooth function

    Raises:
        RpojaxError: there is no such reduction or window.
    """
    for name, found, known in (("reduction", reduction, get_args(Reduction)), ("window", window, get_args(Window))):
        if found not in (*known, *((None,) if name == "reduction" else ())):
            raise RpojaxError.of_argument(name, f"found {found!r}, expected one of {', '.join(known)}")
    settings = MetricSettings(reduction, window, unit, title, low_is_bad, differentiable)

    def mark(function: Function) -> Function:
        setattr(function, _MARK, settings)
        return function

    return mark


_MOST_ROWS = 1000
"""Bound of the degrees of freedom in a description."""


def settings_of(function: MetricFunction) -> MetricSettings:
    """What `metric` says of a function; a function without the mark is one of whole runs."""
    return getattr(function, _MARK, MetricSettings())


def make_metric(name: str, function: MetricFunction, unit: str) -> Metric:
    """Definition of a metric of a user's function; `unit` is that of the name's suffix.

    Raises:
        RpojaxError: the name or the function cannot be used.
    """
    if not _NAME.fullmatch(name):
        raise RpojaxError(f"metrics: found the name {name!r:.60}, expected small letters, digits and underscores")
    inputs, settings = _channel_names(name, function), settings_of(function)
    summary = (inspect.getdoc(function) or "").strip().partition("\n")[0]
    is_of_ticks = settings.reduction is not None
    return Metric(
        name=name,
        unit=settings.unit or unit,
        title=settings.title or name.replace("_", " ").capitalize(),
        meaning=summary or "A metric of the user's own.",
        inputs=inputs,
        reduction=settings.reduction if is_of_ticks else _RunStatistic(name, function, inputs),
        value=_TickValue(name, function, inputs) if is_of_ticks else _all_inputs,
        window=settings.window,
        low_is_bad=settings.low_is_bad,
        has_derivative=is_of_ticks and settings.differentiable,
        source="plugin",
    )


def described_metric(name: str, record: Mapping[str, Any]) -> Metric:
    """Metric of which only the description is known, for reading results without the user's code."""
    freedom = record.get("degrees_of_freedom")
    return Metric(
        name=name,
        unit=str(record.get("unit", "-")),
        title=str(record.get("title", name)),
        meaning=str(record.get("meaning", "")),
        low_is_bad=bool(record.get("low_is_bad", False)),
        has_derivative=bool(record.get("has_derivative", False)),
        degrees_of_freedom=freedom if isinstance(freedom, int) and 0 < freedom < _MOST_ROWS else None,
        reduction="end",
        source="plugin",
    )


def describe(found: Metric) -> dict[str, Any]:
    """Description of a metric, in the types of JSON."""
    return {
        "unit": found.unit,
        "title": found.title,
        "meaning": found.meaning,
        "low_is_bad": found.low_is_bad,
        "has_derivative": found.has_derivative,
        "degrees_of_freedom": found.degrees_of_freedom,
    }


def unknown_channel(metric: str, name: str, known: Iterable[str]) -> RpojaxError:
    """Error of a metric that needs a channel which the scenario does not have."""
    close = difflib.get_close_matches(name, list(known), n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ", such as rho_H"
    return RpojaxError(f"metrics.{metric}: found the argument {name!r}, expected channels of the scenario{hint}")


def _channel_names(name: str, function: MetricFunction) -> tuple[str, ...]:
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        raise RpojaxError(f"metrics.{name}: found {function!r:.80}, expected a function of channels") from None
    plain = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    names = tuple(each.name for each in parameters if each.default is inspect.Parameter.empty and each.kind in plain)
    if not names or any(each.kind not in plain for each in parameters):
        raise RpojaxError(f"metrics.{name}: found other arguments, expected the names of channels, such as rho_H")
    return names


def _all_inputs(_: ModuleType, *quantities: Any) -> WeightedValue:
    return WeightedValue(quantities, None)


@dataclass(frozen=True)
class _RunStatistic:
    """Number of every run from the whole record of its channels, one run at a time."""

    name: str
    function: MetricFunction
    inputs: tuple[str, ...]

    def __call__(self, weighted: WeightedValue, timing: RunTiming) -> Floats:
        columns = [_in_double(values) for values in weighted.value]
        found = [self._value([values[run] for values in columns]) for run in range(len(columns[0]))]
        return np.array(found, dtype=float)

    def _value(self, channels: list[np.ndarray]) -> float:
        try:
            return float(self.function(**dict(zip(self.inputs, channels, strict=True))))
        except RpojaxError:
            raise
        except Exception as error:
            raise _user_error(self.name, error, "a number for the record of a run") from error


@dataclass(frozen=True)
class _TickValue:
    """Value of a tick; a value that is not finite does not count."""

    name: str
    function: MetricFunction
    inputs: tuple[str, ...]
    compiled: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def __call__(self, namespace: ModuleType, *quantities: Any) -> WeightedValue:
        if namespace is not np:
            value = self._traced(*quantities)
            return WeightedValue(value, namespace.isfinite(value))
        value = self._of_records([_in_double(values) for values in quantities])
        return WeightedValue(value, np.isfinite(value))

    def _traced(self, *quantities: Any) -> Any:
        def of_tick(*inputs: Any) -> Any:
            value = jnp.asarray(self.function(**dict(zip(self.inputs, inputs, strict=True))))
            if jnp.iscomplexobj(value):
                raise RpojaxError(f"metrics.{self.name}: found a complex number at a tick, expected a real one")
            return value.astype(jnp.float64)

        try:
            value = _without_undefined_derivative(of_tick)(*map(jnp.asarray, quantities))
        except RpojaxError:
            raise
        except Exception as error:
            raise _user_error(self.name, error, "a function of jax.numpy of the channels of one tick") from error
        if value.shape != ():
            raise RpojaxError(f"metrics.{self.name}: found shape {value.shape} at a tick, expected one number")
        return value

    def _of_records(self, records: list[np.ndarray]) -> np.ndarray:
        """Values (runs, ticks) of records (runs, ticks, ...), in batches of a few sizes."""
        if "batch" not in self.compiled:
            self.compiled["batch"] = jax.jit(jax.vmap(self._traced))
        runs, ticks = records[0].shape[:2]
        count = runs * ticks
        size = max(_SMALLEST_BATCH, 1 << (count - 1).bit_length())
        flat = [np.resize(values.reshape(count, *values.shape[2:]), (size, *values.shape[2:])) for values in records]
        return np.asarray(self.compiled["batch"](*flat))[:count].reshape(runs, ticks)


def _without_undefined_derivative(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a derivative of 0 where its value is not finite.

    There the derivative is often not a number, and in reverse mode 0 times it would enter that of the whole run.
    """
    value = jax.custom_jvp(function)

    @value.defjvp
    def _(inputs: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        found = function(*inputs)
        numbers = tuple(index for index, each in enumerate(inputs) if jnp.issubdtype(each.dtype, jnp.floating))
        slopes = jax.jacfwd(function, argnums=numbers)(*inputs) if numbers else ()
        terms = [
            jnp.sum(jnp.where(jnp.isfinite(found), slope, 0.0) * tangents[index])
            for index, slope in zip(numbers, slopes, strict=True)
        ]
        return found, sum(terms, jnp.zeros_like(found))

    return value


def _in_double(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float64) if np.issubdtype(values.dtype, np.floating) else values


def _user_error(name: str, error: Exception, expected: str) -> RpojaxError:
    text = " ".join(str(error).split())
    return RpojaxError(f"metrics.{name}: found {type(error).__name__} ({text:.120}), expected {expected}")
