"""Names of the topics and frames of several servicers in one bag: each has a namespace of its own.

`/servicer/gps/position` of the servicer `first` is `/first/servicer/gps/position`, its frame `servicer/base_link` is
`first/servicer/base_link`. Time, the target's truth and the Hill frame are the same for all and have no namespace.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.frame_ids import CAMERA, SERVICER
from rpojax.interop.ros2.mcap_or_sqlite3_writer import TimedMessage
from rpojax.interop.ros2.topics import ALL_TOPICS, Topic

_OF_ALL = (topics.CLOCK, topics.TARGET_TRUTH)
"""Topics that are the same for all servicers."""
_TRANSFORMS = (topics.TF, topics.TF_STATIC)
"""Topics without a namespace, to which each servicer adds its own frames."""


@functools.cache
def namespaced_topics(name: str) -> dict[Topic, Topic]:
    """Topics of a servicer of a team, by those of one alone; the same objects at every call."""
    return {
        topic: topic
        if topic in (*_OF_ALL, *_TRANSFORMS)
        else dataclasses.replace(
            topic,
            name=f"/{name}{topic.name}",
            frame_id=_frame(name, topic.frame_id),
            child_frame_id=_frame(name, topic.child_frame_id),
        )
        for topic in ALL_TOPICS
    }


def namespaced(
    messages: Iterator[TimedMessage], name: str, renamed: dict[Topic, Topic], is_first: bool
) -> Iterator[TimedMessage]:
    """Messages of a servicer of a team from those of one alone; what is the same for all comes from the first one."""
    for each in messages:
        if each.topic in _OF_ALL and not is_first:
            continue
        message = _renamed(each.message, name)
        if each.topic is topics.TF and not is_first:
            own = [part for part in message.transforms if part.child_frame_id == _frame(name, SERVICER)]
            message = dataclasses.replace(message, transforms=own)
        yield TimedMessage(each.time_ns, renamed[each.topic], message)


def _frame(name: str, frame: str) -> str:
    return f"{name}/{frame}" if frame in (SERVICER, CAMERA) else frame


def _renamed(message: Any, name: str) -> Any:
    """The message with the frames of a servicer."""
    changes: dict[str, Any] = {}
    if hasattr(message, "header"):
        changes["header"] = dataclasses.replace(message.header, frame_id=_frame(name, message.header.frame_id))
    if hasattr(message, "child_frame_id"):
        changes["child_frame_id"] = _frame(name, message.child_frame_id)
    for part in ("transforms", "detections"):
        if hasattr(message, part):
            changes[part] = [_renamed(each, name) for each in getattr(message, part)]
    return dataclasses.replace(message, **changes) if changes else message
