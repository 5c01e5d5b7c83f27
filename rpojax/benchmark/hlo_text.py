"""Computations of a compiled program, parsed from its optimised HLO text (`Compiled.as_text`)."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_COMPUTATION = re.compile(r"(ENTRY )?%?([\w.\-]+) \(.*\{\s*$")
_INSTRUCTION = re.compile(r"\s+(?:ROOT )?%?([\w.\-]+) = .*?[\s)}\]]([a-z][\w\-]*)\(")
_CALLED_COMPUTATION = re.compile(r"(?:calls|to_apply)=%?([\w.\-]+)")
_LOOP_BODY = re.compile(r"body=%?([\w.\-]+)")
_BRANCH_LIST = re.compile(r"branch_computations=\{([^}]*)\}")
_BRANCH = re.compile(r"(?:true|false)_computation=%?([\w.\-]+)")
_TRIP_COUNT = re.compile(r'"known_trip_count":\{"n":"(\d+)"')
_OP_NAME = re.compile(r'op_name="([^"]*)"')
_FUNCTION = 'xla_cpu_small_call="true"'


@dataclass(frozen=True)
class HloInstruction:
    """One instruction of a computation.

    Attributes:
        name: as in a profile
        opcode: such as fusion or copy
        line: of the text
    """

    name: str
    opcode: str
    line: str

    @property
    def called(self) -> Sequence[str]:
        """Names of the computations that it calls or applies; for a loop and a conditional see below."""
        return _CALLED_COMPUTATION.findall(self.line)

    @property
    def loop_body(self) -> str:
        """Name of the body of a loop."""
        found = _LOOP_BODY.search(self.line)
        assert found is not None, self.line
        return found[1]

    @property
    def branches(self) -> Sequence[str]:
        """Names of the branches of a conditional."""
        listed = _BRANCH_LIST.search(self.line)
        return [name.strip().lstrip("%") for name in listed[1].split(",")] if listed else _BRANCH.findall(self.line)

    @property
    def trip_count(self) -> int | None:
        """Passes of a loop through its body, None if the compiler does not know them."""
        found = _TRIP_COUNT.search(self.line)
        return int(found[1]) if found else None

    @property
    def is_function(self) -> bool:
        """Whether a call is of a small loop that XLA compiles as one function on a CPU."""
        return self.opcode == "call" and _FUNCTION in self.line

    @property
    def op_name(self) -> str:
        """Names of its scopes and its operation in the traced function, empty if it comes from the compiler."""
        found = _OP_NAME.search(self.line)
        return found[1] if found else ""


@dataclass(frozen=True)
class HloProgram:
    """A compiled program.

    Attributes:
        entry: name of the computation with which it begins
        computations: name -> instructions, those of fusions included
    """

    entry: str
    computations: Mapping[str, Sequence[HloInstruction]]


def parse(text: str) -> HloProgram:
    """The program of an optimised HLO text."""
    computations: dict[str, list[HloInstruction]] = {}
    entry, current = "", []
    for line in text.splitlines():
        if begin := _COMPUTATION.match(line):
            current = computations[begin[2]] = []
            entry = begin[2] if begin[1] else entry
        elif match := _INSTRUCTION.match(line):
            current.append(HloInstruction(match[1], match[2], line))
    return HloProgram(entry, computations)
