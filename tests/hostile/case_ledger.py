"""Hostile cases, how each must end, and the ledger of what was tried."""

import contextlib
import resource
import signal
import time
import unicodedata
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

from rpojax.errors import RpojaxError

LONGEST_LINE = 400
LONGEST_S = 5.0
LONGEST_WAIT_S = 30.0
"""Time without an end after which a case counts as waiting; others may use the processor meanwhile [s]."""
MOST_BYTES = 2**30


@dataclass(frozen=True)
class Case:
    """One hostile input.

    Attributes:
        kind: class of cases
        damage: what is wrong
        place: key, file or option that is wrong
        act: gives the input to the package; ends in success or in an error of the package
    """

    kind: str
    damage: str
    place: str
    act: Callable[[], object]


@dataclass
class Ledger:
    """What was tried and how it ended.

    Attributes:
        ends: class -> end (accepted, refused) -> number of cases
        damages: class -> damage -> number of cases
        places: class -> key, file or option -> number of cases
        faults: cases that ended in another way
        longest_s: class -> processor time of the slowest case [s]
        most_bytes: class -> growth of memory of the largest case [bytes]
    """

    ends: dict[str, Counter[str]] = field(default_factory=dict)
    damages: dict[str, Counter[str]] = field(default_factory=dict)
    places: dict[str, Counter[str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    longest_s: dict[str, float] = field(default_factory=dict)
    most_bytes: dict[str, int] = field(default_factory=dict)

    def run(self, case: Case) -> None:
        """Runs a case and records its end."""
        name = f"{case.kind}: {case.damage} at {case.place}"[:200]
        before, began = _start_of_peak(), time.process_time()
        end = "accepted"
        try:
            with _limit(LONGEST_WAIT_S):
                case.act()
        except RpojaxError as error:
            end = "refused"
            if problem := line_problem(str(error)):
                self.faults.append(f"{name}: {problem}: {str(error)[:120]!r}")
        except AssertionError as error:
            end = "fault"
            self.faults.append(f"{name}: {error}")
        except BaseException as error:
            end = "fault"
            self.faults.append(f"{name}: {type(error).__name__}: {str(error)[:200]}")
        spent, grown = time.process_time() - began, max(0, _peak() - before)
        if spent > LONGEST_S:
            self.faults.append(f"{name}: {spent:.1f} s of processor time")
        if grown > MOST_BYTES:
            self.faults.append(f"{name}: {grown} bytes")
        self.ends.setdefault(case.kind, Counter())[end] += 1
        self.damages.setdefault(case.kind, Counter())[case.damage] += 1
        self.places.setdefault(case.kind, Counter())[case.place] += 1
        self.longest_s[case.kind] = max(self.longest_s.get(case.kind, 0.0), spent)
        self.most_bytes[case.kind] = max(self.most_bytes.get(case.kind, 0), grown)

    @property
    def total(self) -> int:
        """Number of cases."""
        return sum(counts.total() for counts in self.ends.values())

    def lines(self) -> list[str]:
        """Rows of a table of classes: cases, ends, kinds of damage, places, slowest and largest case."""
        rows = ["| class | cases | accepted | refused | faults | damages | places | slowest [s] | largest [MiB] |"]
        rows.append("|---|---|---|---|---|---|---|---|---|")
        for kind, ends in sorted(self.ends.items()):
            numbers = (ends.total(), ends["accepted"], ends["refused"], ends["fault"])
            kinds = (len(self.damages[kind]), len(self.places[kind]))
            sizes = f"{self.longest_s[kind]:.2f} | {self.most_bytes[kind] / 2**20:.0f}"
            rows.append(f"| {kind} | {' | '.join(map(str, numbers))} | {' | '.join(map(str, kinds))} | {sizes} |")
        return rows

    def coverage(self) -> list[str]:
        """Lines that name, for each class, the kinds of damage with their cases, and what was damaged."""
        lines = []
        for kind, damages in sorted(self.damages.items()):
            named = ", ".join(f"{damage} {count}" for damage, count in damages.most_common())
            places = [name for name, _ in self.places[kind].most_common()]
            more = f" and {len(places) - 12} more" if len(places) > 12 else ""
            lines.append(f"{kind}: {named}; at {', '.join(places[:12])}{more}")
        return lines


def run_cases(ledger: Ledger, cases: SearchStrategy[Case], count: int, first_seed: int) -> None:
    """Runs cases that hypothesis draws, from a seed, until there are `count` more."""
    expected = ledger.total + count
    number = first_seed
    while ledger.total < expected:
        left = expected - ledger.total

        @seed(number)
        @settings(
            max_examples=min(left, 2000),
            deadline=None,
            database=None,
            derandomize=False,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(cases)
        def run_one(case: Case) -> None:
            ledger.run(case)

        run_one()
        number += 1


def line_problem(text: str) -> str:
    """Why a message is not one line of limited length that a terminal can show; empty if it is."""
    if len(text) > LONGEST_LINE:
        return f"{len(text)} characters"
    if any(unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp") for letter in text):
        return "control characters"
    return "" if text.strip() else "an empty message"


class _limit:
    """Raises `TimeoutError` in the body after a time [s]."""

    def __init__(self, limit_s: float) -> None:
        self.limit_s = limit_s

    def __enter__(self) -> None:
        self.before = signal.signal(signal.SIGALRM, self._end)
        signal.setitimer(signal.ITIMER_REAL, self.limit_s)

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, self.before)

    def _end(self, number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"more than {self.limit_s} s")


def _start_of_peak() -> int:
    """Memory in use now [bytes], from which the peak counts."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _peak() -> int:
    """Largest memory in use since the peak was reset [bytes]."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    except (OSError, StopIteration):
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
