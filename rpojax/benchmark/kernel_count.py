"""Kernels that a device starts in one tick of the compiled closed loop, counted in its optimised HLO text.

A kernel is an instruction that is started by itself: a fusion, a copy, a reduction, a sort, a call of a library, but no
part of one and nothing that only names values. A loop counts as its body times its passes, a call as what it calls.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rpojax.benchmark import hlo_text, operation_count
from rpojax.benchmark.hlo_text import HloInstruction, HloProgram

_STARTED_BEFORE = ("-done", "-update")
"""Ends of the opcodes that wait for a kernel which another instruction has started."""

_WORKLESS_OPCODES = operation_count.WORKLESS_OPCODES | {"after-all", "add-dependency", "opt-barrier"}


@dataclass(frozen=True)
class ScopeKernels:
    """Kernels of one scope with the same number of passes through inner loops.

    Attributes:
        scope: as in `operation_count`
        passes: of the inner loops that contain them, per tick; 1 outside of inner loops
        kernels: started in each pass
    """

    scope: str
    passes: int
    kernels: int

    @property
    def per_tick(self) -> int:
        """Kernels started in a tick."""
        return self.passes * self.kernels


@dataclass(frozen=True)
class KernelCount:
    """Kernels started in a tick.

    Attributes:
        fewest: with the shortest branch of every conditional
        most: with the longest one
        decisions: conditionals per tick, and loops whose passes the compiler does not know: an accelerator waits there
            until the host has read which way to go
        contributions: of each scope with the longest branches, the largest first
    """

    fewest: int
    most: int
    decisions: int
    contributions: Sequence[ScopeKernels]


def kernels_per_tick(text: str, open_functions: bool = False) -> KernelCount:
    """Kernels in the loop over ticks: the outermost loop, or loop in one of unknown length, with the most kernels.

    On a CPU XLA compiles small loops as functions, each of which is one kernel; `open_functions` counts their content,
    as on an accelerator. Without a loop the count is of the whole program.
    """
    program = hlo_text.parse(text)
    bodies = _loops_over_ticks(program, program.entry) or [program.entry]
    return max((_count(program, body, open_functions) for body in bodies), key=lambda count: count.most)


def _loops_over_ticks(program: HloProgram, computation: str) -> list[str]:
    """Bodies of the loops that may be the one over ticks, which is in one of unknown length if that is not known."""
    loops = [each for each in program.computations[computation] if each.opcode == "while"]
    inner = [[] if each.trip_count else _loops_over_ticks(program, each.loop_body) for each in loops]
    return [body for each, found in zip(loops, inner, strict=True) for body in found or [each.loop_body]]


def _count(program: HloProgram, computation: str, open_functions: bool) -> KernelCount:
    longest = _Walk(program, open_functions, max).count(computation)
    shortest = _Walk(program, open_functions, min).count(computation)
    contributions = [ScopeKernels(scope, passes, kernels) for (scope, passes), kernels in longest.kernels.items()]
    return KernelCount(
        fewest=shortest.per_tick,
        most=longest.per_tick,
        decisions=longest.decisions,
        contributions=sorted(contributions, key=lambda each: -each.per_tick),
    )


@dataclass
class _Tally:
    """Kernels by scope and passes of inner loops, and decisions of the host."""

    kernels: Counter[tuple[str, int]] = field(default_factory=Counter)
    decisions: int = 0

    @property
    def per_tick(self) -> int:
        return sum(passes * kernels for (_, passes), kernels in self.kernels.items())

    def add(self, other: "_Tally", passes: int = 1) -> None:
        """Adds what each of some passes starts."""
        for (scope, inner), kernels in other.kernels.items():
            self.kernels[scope, passes * inner] += kernels
        self.decisions += passes * other.decisions


@dataclass(frozen=True)
class _Walk:
    """Count of computations with what they call; `choose` picks the branch of a conditional by its kernels."""

    program: HloProgram
    open_functions: bool
    choose: Callable[..., _Tally]

    def count(self, computation: str) -> _Tally:
        tally = _Tally()
        for each in self.program.computations[computation]:
            if each.opcode == "while":
                tally.add(self.count(each.loop_body), each.trip_count or 1)
                tally.decisions += each.trip_count is None
            elif each.opcode == "conditional":
                tally.add(self.choose(map(self.count, each.branches), key=lambda branch: branch.per_tick))
                tally.decisions += 1
            elif each.opcode == "call" and (self.open_functions or not each.is_function):
                for called in each.called:
                    tally.add(self.count(called))
            elif _is_kernel(each):
                tally.kernels[operation_count.scope_of(each), 1] += 1
        return tally


def _is_kernel(instruction: HloInstruction) -> bool:
    return instruction.opcode not in _WORKLESS_OPCODES and not instruction.opcode.endswith(_STARTED_BEFORE)
