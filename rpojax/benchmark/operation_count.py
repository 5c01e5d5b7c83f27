"""What a compiled program does, by its optimised text: its instructions, and the part of the tick that they belong to.

The text is XLA's own; nothing here is asked of JAX beyond `Compiled.as_text`.
"""

import re
from dataclasses import dataclass

SCOPES = ("draw", "sense", "navigate", "plan_burn", "guide", "act", "check", "observe")
"""Named scopes of a tick, in their order."""

OTHER = "other"
"""Where an instruction belongs that comes from no scope: the loop over ticks, its counters, channels put in place."""

COPIES = "copies"
"""Where a copy belongs that the compiler has added: of what a loop carries, from one place in memory to another."""

_COMPUTATION = re.compile(r"(?:ENTRY )?%?([\w.\-]+) \(.*\{\s*$")
_INSTRUCTION = re.compile(r"\s+(?:ROOT )?%?([\w.\-]+) = .*?[\s)}\]]([a-z][\w\-]*)\(")
_CALLED_COMPUTATION = re.compile(r"(?:calls|to_apply)=%?([\w.\-]+)")
_OP_NAME = re.compile(r'op_name="([^"]*)"')
_SCOPE = re.compile(rf"(?:^|[/(])({'|'.join(SCOPES)})(?=[/)]|$)")
_WORKLESS_OPCODES = {"parameter", "constant", "tuple", "get-tuple-element", "bitcast"}
_CONTROL_FLOW_OPCODES = {"while", "conditional", "call"}


@dataclass(frozen=True)
class Instruction:
    """One instruction that is carried out by itself: not a part of a fusion, and not one without work.

    Attributes:
        name: as in a profile
        kind: such as fusion or copy
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
    """Instructions of a program's optimised text."""
    inner = _fused_computations(text)
    found, inside = [], False
    for line in text.splitlines():
        if begun := _COMPUTATION.match(line):
            inside = begun[1] in inner
        elif not inside and (made := _INSTRUCTION.match(line)) and made[2] not in _WORKLESS_OPCODES:
            found.append(Instruction(name=made[1], opcode=made[2], scope=_scope(made[2], line)))
    return found


def _fused_computations(text: str) -> set[str]:
    """Names of the computations that are parts of an instruction: of a fusion, a reduction, a sort."""
    names = set()
    for line in text.splitlines():
        made = _INSTRUCTION.match(line)
        if made and made[2] not in _CONTROL_FLOW_OPCODES:
            names |= set(_CALLED_COMPUTATION.findall(line))
    return names


def _scope(kind: str, line: str) -> str:
    """The innermost named scope that an instruction's origin tells."""
    origin = _OP_NAME.search(line)
    if origin is None and kind == "copy":
        return COPIES
    names = _SCOPE.findall(origin[1]) if origin else []
    return names[-1] if names else OTHER
