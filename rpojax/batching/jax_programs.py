"""All that batching uses of JAX beyond its public promise: jaxprs, and names and parameters of their primitives.

A program is a jaxpr, an operation is one of its equations. A new version of JAX needs to be checked against this module
alone; with one that `is_known` does not hold for, `jax.vmap` takes the place of this batching.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, auto
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jax.interpreters import batching, mlir

from rpojax.errors import BatchingError

KNOWN_VERSIONS = (0, 10), (0, 12)
"""Oldest and newest minor versions of JAX with which this module is tested."""


def is_known(version: tuple[int, ...] = jax.__version_info__) -> bool:
    """Whether this module is tested with that version of JAX, by default the installed one."""
    return KNOWN_VERSIONS[0] <= version[:2] <= KNOWN_VERSIONS[1]


class Form(Enum):
    """What an operation does with its operands, as far as a trailing batch axis is concerned."""

    ELEMENTWISE = auto()
    """All operands have one shape, or are scalars."""
    ONE_OPERAND = auto()
    """Its axes are counted from the front."""
    JOIN = auto()
    """Operands become parts of one array."""
    SELECT = auto()
    DYNAMIC_SLICE = auto()
    GATHER = auto()
    PAD = auto()
    CHANGE_OF_WIDTH = auto()
    """It appends an axis, or takes the last one away."""
    CALL = auto()
    SCAN = auto()
    CONDITIONAL = auto()
    ANY_OF_BATCH = auto()
    """Its result is shared by the whole batch."""
    OTHER = auto()
    """Batched by the rule that JAX has for it."""


_ELEMENTWISE = (
    "abs acos add and asin atan atan2 bitcast_convert_type cbrt ceil clamp convert_element_type copy cos cosh div "
    "eq erf erf_inv erfc exp exp2 expm1 floor ge gt integer_pow is_finite le log log1p logistic lt max min mul ne "
    "neg nextafter not or pow rem round rsqrt shift_left shift_right_arithmetic shift_right_logical sign sin sinh "
    "sqrt square stop_gradient sub tan tanh xor"
)
_ONE_OPERAND = (
    "argmax argmin broadcast_in_dim reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum reshape slice "
    "squeeze transpose"
)
_PURE_FORMS = {
    **dict.fromkeys(_ELEMENTWISE.split(), Form.ELEMENTWISE),
    **dict.fromkeys(_ONE_OPERAND.split(), Form.ONE_OPERAND),
    **dict.fromkeys(("concatenate", "stack"), Form.JOIN),
    "dynamic_slice": Form.DYNAMIC_SLICE,
    "gather": Form.GATHER,
    "pad": Form.PAD,
    "select_n": Form.SELECT,
}
"""Forms of primitives whose result depends on operands and parameters alone."""

_PRIMITIVES_WITH_FUNCTIONS = {
    *("cond", "jit", "scan", "while", "checkpoint", "remat2"),
    *("custom_jvp_call", "custom_vjp_call", "custom_vmap_call", "custom_linear_solve", "call_hi_primitive"),
    *("pure_callback", "reduce", "reduce_window", "scatter", "scatter-add", "scatter-sub", "scatter-mul"),
    *("scatter-min", "scatter-max"),
}
"""Primitives with functions as parameters whose batching by JAX has a test here."""


def _slice_parameters(parameters: Mapping[str, Any], size: int) -> dict[str, Any]:
    return {
        "start_indices": (*parameters["start_indices"], 0),
        "limit_indices": (*parameters["limit_indices"], size),
        "strides": None if parameters["strides"] is None else (*parameters["strides"], 1),
    }


def _broadcast_parameters(parameters: Mapping[str, Any], size: int) -> dict[str, Any]:
    shape = parameters["shape"]
    return {"shape": (*shape, size), "broadcast_dimensions": (*parameters["broadcast_dimensions"], len(shape))}


_PARAMETERS_WITH_BATCH_AXIS: dict[str, Callable[[Mapping[str, Any], int], dict[str, Any]]] = {
    "broadcast_in_dim": _broadcast_parameters,
    "dynamic_slice": lambda parameters, size: {"slice_sizes": (*parameters["slice_sizes"], size)},
    "gather": lambda parameters, size: {"slice_sizes": (*parameters["slice_sizes"], size)},
    "pad": lambda parameters, size: {"padding_config": (*parameters["padding_config"], (0, 0, 0))},
    "reshape": lambda parameters, size: {"new_sizes": (*parameters["new_sizes"], size)},
    "slice": _slice_parameters,
    "transpose": lambda parameters, size: {"permutation": (*parameters["permutation"], len(parameters["permutation"]))},
}
"""Parameters that change if the operand has a trailing batch axis; those of other primitives do not."""


_ANY_OF_BATCH = core.Primitive("any_of_batch")
_ANY_OF_BATCH.def_impl(lambda flag: flag)
_ANY_OF_BATCH.def_abstract_eval(lambda flag: flag)
mlir.register_lowering(_ANY_OF_BATCH, lambda _, flag: [flag])
batching.primitive_batchers[_ANY_OF_BATCH] = lambda flags, _: (any_of_batch(jnp.any(flags[0])), None)


def any_of_batch(flag: Any) -> Any:
    """Whether a scalar flag is true for any element of the batches in which the function is evaluated.

    Outside of a batch it is the flag itself. The result is the same for the whole batch, so that a branch on it stays a
    branch: what is costly, and needed by few elements at a time, is left out while no element needs it.
    """
    return _ANY_OF_BATCH.bind(flag)


class Operation:
    """One operation of a program.

    Attributes:
        name: of the primitive
        operands: variables, and numpy arrays for constants in the text of the program
        results: variables
    """

    def __init__(self, equation: Any) -> None:
        self._equation = equation
        self._parameters: Mapping[str, Any] = equation.params
        self.name: str = equation.primitive.name
        self.operands: list[Any] = [_read_atom(atom) for atom in equation.invars]
        self.results: list[Any] = list(equation.outvars)

    @property
    def form(self) -> Form:
        """How the operation is batched."""
        if self.name == "cond":
            # A choice by platform must be left to JAX: the other branches may not exist on this one.
            return Form.OTHER if self._parameters.get("branches_platforms") else Form.CONDITIONAL
        if self.name == _ANY_OF_BATCH.name:
            return Form.ANY_OF_BATCH
        if self.name == "scan":
            return Form.OTHER if self._parameters.get("_split_transpose") else Form.SCAN
        if self.name in ("jit", "closed_call"):
            return Form.CALL if self._has_no_placement() else Form.OTHER
        if self.name == "bitcast_convert_type" and self._changes_width():
            return Form.CHANGE_OF_WIDTH
        return _PURE_FORMS.get(self.name, Form.OTHER)

    @property
    def sharing_key(self) -> Any:
        """Key that is equal for operations with the same result from the same operands; None where that is unknown."""
        return (self.name, tuple(sorted(self._parameters.items()))) if self.name in _PURE_FORMS else None

    @property
    def called_program(self) -> "Program":
        """Program of a `Form.CALL`."""
        return Program(self._parameters["call_jaxpr" if self.name == "closed_call" else "jaxpr"])

    @property
    def branches(self) -> "list[Program]":
        """Programs of a `Form.CONDITIONAL`, whose first operand is their index."""
        return [Program(branch) for branch in self._parameters["branches"]]

    @property
    def scan(self) -> "Scan":
        """Parts of a `Form.SCAN`."""
        body = Program(self._parameters["jaxpr"])
        # By shapes, since parameters differ between versions of JAX: only inputs and outputs have the axis of the loop.
        inputs = sum(_rank(whole) > _rank(part) for whole, part in zip(self.operands, body.inputs, strict=True))
        carry = sum(_rank(whole) == _rank(part) for whole, part in zip(self.results, body.outputs, strict=True))
        first = len(self.operands) - inputs - carry
        options = {name: self._parameters[name] for name in ("length", "reverse", "unroll")}
        return Scan(body, slice(0, first), slice(first, first + carry), options)

    def named_scope(self) -> contextlib.AbstractContextManager[Any]:
        """Context with the named scope in which the operation was traced."""
        scope = str(self._equation.source_info.name_stack)
        return jax.named_scope(scope) if scope else contextlib.nullcontext()

    def settings(self) -> contextlib.AbstractContextManager[Any]:
        """Context with the settings of JAX under which it was traced, such as metadata for XLA."""
        return self._equation.ctx.manager

    def evaluate(self, *arrays: Any) -> list[Any]:
        """Results from arrays of the shapes of the operands; functions with custom derivatives keep them."""
        return self._bind(arrays, self._equation.primitive.get_bind_params(self._parameters))

    def evaluate_batched(self, arrays: Sequence[Any], size: int) -> list[Any]:
        """Results with a trailing batch axis of this size, from arrays of which the first has one."""
        change = _PARAMETERS_WITH_BATCH_AXIS.get(self.name)
        parameters = {**self._parameters, **(change(self._parameters, size) if change else {})}
        if self.name == "gather":
            numbers, rank = parameters["dimension_numbers"], len(self.results[0].aval.shape)
            parameters["dimension_numbers"] = numbers._replace(offset_dims=(*numbers.offset_dims, rank))
        return self._bind(arrays, parameters)

    def check_functions(self) -> None:
        """Refuses an operation with functions as parameters whose batching is unknown.

        Raises:
            BatchingError: naming the primitive.
        """
        known = self.name in _PRIMITIVES_WITH_FUNCTIONS
        if not known and any(_contains_function(value) for value in self._parameters.values()):
            raise BatchingError(
                f"batching: found the primitive {self.name!r}, expected one whose functions are known to be batched"
            )

    def _bind(self, arrays: Sequence[Any], parameters: Mapping[str, Any]) -> list[Any]:
        result = self._equation.primitive.bind(*arrays, **parameters)
        return list(result) if self._equation.primitive.multiple_results else [result]

    def _has_no_placement(self) -> bool:
        """Whether a called function leaves devices and layouts of its arrays, and options of the compiler, open."""

        def given(*names: str) -> list[Any]:
            return [each for name in names for each in self._parameters.get(name, ())]

        placed = [each for each in given("in_shardings", "out_shardings") if type(each).__name__ != "UnspecifiedValue"]
        return not (placed or any(given("in_layouts", "out_layouts")) or given("compiler_options_kvs"))

    def _changes_width(self) -> bool:
        old, new = self._equation.invars[0].aval.dtype, self._parameters["new_dtype"]
        return np.dtype(old).itemsize != np.dtype(new).itemsize


class Program:
    """A traced function of arrays.

    Attributes:
        inputs: variables
        constants: variables and arrays that the function closes over
        operations: in order of evaluation
        outputs: variables, and numpy arrays for constants in the text of the program
    """

    def __init__(self, closed: Any) -> None:
        self.inputs: list[Any] = list(closed.jaxpr.invars)
        self.constants: list[tuple[Any, Any]] = list(zip(closed.jaxpr.constvars, closed.consts, strict=True))
        self.operations = [Operation(equation) for equation in closed.jaxpr.eqns]
        self.outputs: list[Any] = [_read_atom(atom) for atom in closed.jaxpr.outvars]


class Scan(NamedTuple):
    """A loop with a carry.

    Attributes:
        body: from constants, carry and one row of each input to the new carry and one row of each output
        constants: which operands are the same in all iterations
        carry: which operands are the carry; inputs follow
        options: of `jax.lax.scan`
    """

    body: Program
    constants: slice
    carry: slice
    options: dict[str, Any]


def pure_program(closed: Any) -> Program:
    """The program of a closed jaxpr.

    Raises:
        BatchingError: the function has effects.
    """
    if closed.effects:
        kinds = ", ".join(sorted({type(effect).__name__ for effect in closed.effects}))
        raise BatchingError(
            f"batching: found effects ({kinds}), expected a function without printing, callbacks, references and named "
            "axes"
        )
    return Program(closed)


def _read_atom(atom: Any) -> Any:
    """A variable, or the value of a literal with its type."""
    return np.asarray(atom.val, dtype=atom.aval.dtype) if isinstance(atom, core.Literal) else atom  # pyright: ignore[reportAttributeAccessIssue]


def _rank(value: Any) -> int:
    """Number of axes of a variable or an array."""
    return len(value.aval.shape if hasattr(value, "aval") else np.shape(value))


def _contains_function(value: Any) -> bool:
    if type(value) in (tuple, list):  # not the generator of a random key, a tuple of functions by name
        return any(map(_contains_function, value))
    return isinstance(value, core.Jaxpr | core.ClosedJaxpr) or (callable(value) and not isinstance(value, type))
