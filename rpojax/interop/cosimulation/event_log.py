"""What went wrong in a live run, counted by topic and reason, and told without flooding the reader."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from rpojax.interop.ros2.topics import Topic

LineWriter = Callable[[str], None]


@dataclass
class EventLog:
    """Counts of a run.

    Attributes:
        tell: gets a line on the first event of a kind, then on the 10th, the 100th and so on
        ignored: messages by topic and reason
        late: commands that did not come in time, by topic
        limited: commands that were beyond what the drive can give, by topic
    """

    write_line: LineWriter
    ignored: Counter[tuple[str, str]] = field(default_factory=Counter)
    late: Counter[str] = field(default_factory=Counter)
    limited: Counter[str] = field(default_factory=Counter)

    def count_ignored(self, topic: Topic, reason: str) -> None:
        """One more message that does not count."""
        self.ignored[topic.name, reason] += 1
        self._report(self.ignored[topic.name, reason], f"{topic.name}: ignored, {reason}")

    def count_late(self, topic: Topic, time_s: float, fallback: str) -> None:
        """One more command that did not come in time; the simulator does something else `instead`."""
        self.late[topic.name] += 1
        self._report(self.late[topic.name], f"{topic.name}: no command for {time_s:.1f} s in time, {fallback}")

    def count_limited(self, topic: Topic) -> None:
        """One more command that the drive could not follow."""
        self.limited[topic.name] += 1
        self._report(self.limited[topic.name], f"{topic.name}: beyond the limit of the drive, which gives what it can")

    def _report(self, count: int, text: str) -> None:
        if str(count).strip("0") == "1":
            self.write_line(text if count == 1 else f"{text} ({count} times)")
