"""Event log of live runs."""

from rpojax.interop.cosimulation.command_checks import RejectionReason
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2 import topics


def test_repeated_events_are_printed_at_powers_of_ten() -> None:
    lines: list[str] = []
    events = EventLog(lines.append)
    for _ in range(250):
        events.count_ignored(topics.WHEEL_COMMAND, RejectionReason.STALE)
    name = topics.WHEEL_COMMAND.name
    text = f"{name}: ignored, stale stamp"
    assert lines == [text, f"{text} (10 times)", f"{text} (100 times)"]
    assert events.ignored == {(name, "stale stamp"): 250}
