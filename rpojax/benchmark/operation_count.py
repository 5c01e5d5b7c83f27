"""Instructions of a compiled program, parsed from its optimised HLO text, with the stage of the tick of each."""

import re
from dataclasses import dataclass

from rpojax.benchmark import hlo_text
from rpojax.benchmark.hlo_text import HloInstruction, HloProgram

SCOPES = ("draw", "sense", "navigate", "plan_burn", "guide", "act", "check", "observe")
"""Named scopes of a tick, in their order."""

OTHER = "other"
"""Scope of instructions outside of all named scopes: the loop over ticks, its counters, writing of channels."""

COPIES = "copies"
"""Scope of copies that the compiler adds, between buffers of values that a loop carries."""

_SCOPE = re.compile(rf"(?:^|[/(])({'|'.join(SCOPES)})(?=[/)]|$)")

WORKLESS_OPCODES = {"parameter", "constant", "tuple", "get-tuple-element", "bitcast"}
"""Opcodes that only name values."""

CONTROL_FLOW_OPCODES = {"while", "conditional", "call"}
"""Opcodes of instructions that start others."""


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
        return self.opcode in CONTROL_FLOW_OPCODES


def instructions(text: str) -> list[Instruction]:
    """Instructions of a program's optimised HLO text (`Compiled.as_text`)."""
    program = hlo_text.parse(text)
    fused = _fused_computations(program)
    return [
        Instruction(each.name, each.opcode, scope_of(each))
        for computation, content in program.computations.items()
        if computation not in fused
        for each in content
        if each.opcode not in WORKLESS_OPCODES
    ]


def _fused_computations(program: HloProgram) -> set[str]:
    """Names of the computations that are parts of an instruction: of a fusion, a reduction, a sort."""
    return {
        name
        for content in program.computations.values()
        for each in content
        if each.opcode not in CONTROL_FLOW_OPCODES
        for name in each.called
    }


def scope_of(instruction: HloInstruction) -> str:
    """The innermost named scope in the metadata of an instruction."""
    if instruction.opcode == "copy" and not instruction.op_name:
        return COPIES
    names = _SCOPE.findall(instruction.op_name)
    return names[-1] if names else OTHER
