"""Instructions of a compiled program, parsed from its optimised HLO text, with the stage of the tick of each."""

import re
from dataclasses import dataclass

SCOPES = ("draw", "sense", "navigate", "plan_burn", "guide", "act", "check", "observe")
"""Named scopes of a tick, in their order."""

OTHER = "other"
"""Scope of instructions outside of all named scopes: the loop over ticks, its counters, writing of channels."""

COPIES = "copies"
"""Scope of copies that the compiler adds, between buffers of values that a loop carries."""

_COMPUTATION = re.compile(r"(?:ENTRY )?%?([\w.\-]+) \(.*\{\s*$")
_INSTRUCTION = re.compile(r"\s+(?:ROOT )?%?([\w.\-]+) = .*?[\s)}\]]([a-z][\w\-]*)\(")
_CALLED_COMPUTATION = re.compile(r"(?:calls|to_apply)=%?([\w.\-]+)")
_OP_NAME = re.compile(r'op_name="([^"]*)"')
_SCOPE = re.compile(rf"(?:^|[/(])({'|'.join(SCOPES)})(?=[/)]|$)")
_WORKLESS_OPCODES = {"parameter", "constant", "tuple", "get-tuple-element", "bitcast"}
_CONTROL_FLOW_OPCODES = {"while", "conditional", "call"}


@dataclass(frozen=True)
class Instruction:
    """One instruction that is executed by itself, neither part of a fusion nor without work.

    Attributes:
        name: as in a profile
        opcode: such as fusion or copy
        scope: one of `SCOPES`, `OTHER` or `COPIES`
    """

    name: str
    opcode: str
    scope: str

    @property
    def contains_instructions(self) -> bool:
        """Whether its time is that of other instructions: a loop, a branch, a call."""
        return self.opcode in _CONTROL_FLOW_OPCODES


def instructions(text: str) -> list[Instruction]:
    """Instructions of a program's optimised HLO text (`Compiled.as_text`)."""
    fused = _fused_computations(text)
    found, inside_fused = [], False
    for line in text.splitlines():
        if begin := _COMPUTATION.match(line):
            inside_fused = begin[1] in fused
        elif not inside_fused and (match := _INSTRUCTION.match(line)) and match[2] not in _WORKLESS_OPCODES:
            found.append(Instruction(name=match[1], opcode=match[2], scope=_scope(match[2], line)))
    return found


def _fused_computations(text: str) -> set[str]:
    """Names of the computations that are parts of an instruction: of a fusion, a reduction, a sort."""
    names = set()
    for line in text.splitlines():
        match = _INSTRUCTION.match(line)
        if match and match[2] not in _CONTROL_FLOW_OPCODES:
            names |= set(_CALLED_COMPUTATION.findall(line))
    return names


def _scope(opcode: str, line: str) -> str:
    """The innermost named scope in the metadata of an instruction."""
    origin = _OP_NAME.search(line)
    if origin is None and opcode == "copy":
        return COPIES
    names = _SCOPE.findall(origin[1]) if origin else []
    return names[-1] if names else OTHER
