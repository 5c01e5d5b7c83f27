"""Log of ignored, late and limited commands of a live run, counted by topic and printed at powers of ten."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from rpojax.interop.ros2.topics import Topic

LineWriter = Callable[[str], None]


@dataclass
class EventLog:
    """Event counts of a run.

    Attributes:
        write_line: called with a line at the 1st, 10th, 100th ... event of a kind
        ignored: messages by topic and reason
        late: commands that did not arrive in time, by topic
        limited: commands beyond the limit of the drive, by topic
    """

    write_line: LineWriter
    ignored: Counter[tuple[str, str]] = field(default_factory=Counter)
    late: Counter[str] = field(default_factory=Counter)
    limited: Counter[str] = field(default_factory=Counter)

    def count_ignored(self, topic: Topic, reason: str) -> None:
        """Counts a message that is ignored."""
        self.ignored[topic.name, reason] += 1
        self._report(self.ignored[topic.name, reason], f"{topic.name}: ignored, {reason}")

    def count_late(self, topic: Topic, time_s: float, fallback: str) -> None:
        """Counts a command that did not arrive in time; `fallback` describes what the simulator does instead."""
        self.late[topic.name] += 1
        self._report(self.late[topic.name], f"{topic.name}: no command for {time_s:.1f} s in time, {fallback}")

    def count_limited(self, topic: Topic) -> None:
        """Counts a command beyond the limit of the drive."""
        self.limited[topic.name] += 1
        self._report(self.limited[topic.name], f"{topic.name}: beyond the limit of the drive, limited")

    def _report(self, count: int, text: str) -> None:
        if str(count).strip("0") == "1":
            self.write_line(text if count == 1 else f"{text} ({count} times)")
