"""Bag of one run of a campaign: its topics, messages and provenance.

Names of the topics and frames of several servicers in one bag: each has a namespace of its own.

`/servicer/gps/position` of the servicer `first` is `/first/servicer/gps/position`, its frame `servicer/base_link` is
`first/servicer/base_link`. Time, the target's truth and the Hill frame are the same for all and have no namespace.
"""

import dataclasses
import enum
import functools
import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.ros2 import mcap_or_sqlite3_writer, message_builders, topics
from rpojax.interop.ros2.mcap_or_sqlite3_writer import BagFormat, TimedMessage
from rpojax.interop.ros2.message_builders import tick_messages
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.topics import ALL_TOPICS, CAMERA, SERVICER, Topic
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.version import __version__

_OF_ALL = (topics.CLOCK, topics.TARGET_TRUTH)
"""Topics that are the same for all servicers."""
_TRANSFORMS = (topics.TF, topics.TF_STATIC)
"""Topics without a namespace, to which each servicer adds its own frames."""
ProgressCallback = Callable[[int, int], None]
"""Called with the number of ticks written and the number of all."""


@functools.cache
def namespaced_topics(name: str) -> dict[Topic, Topic]:
    """Topic of a servicer alone -> the same topic in the namespace `name` of a team; the same objects at every call."""
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
    """Messages of a servicer alone, renamed for a team, without mountings; what is common to all is from the first."""
    for each in messages:
        if each.topic is topics.TF_STATIC or (each.topic in _OF_ALL and not is_first):
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


class ImageStorage(enum.StrEnum):
    """Encoding of a rendered camera's images in a bag."""

    RAW = "raw"
    COMPRESSED = "compressed"
    NONE = "none"


_IMAGE_TOPICS = {
    ImageStorage.RAW: topics.IMAGE,
    ImageStorage.COMPRESSED: topics.COMPRESSED_IMAGE,
    ImageStorage.NONE: None,
}


def resolve_image_storage(camera_model: str, requested: str) -> ImageStorage:
    """Encoding of the images of a camera model; `auto` is raw for a rendered camera, none for the others.

    Raises:
        RpojaxError: images are requested of a camera that takes none.
    """
    automatic = ImageStorage.RAW if camera_model == "rendered" else ImageStorage.NONE
    images = automatic if requested == "auto" else ImageStorage(requested)
    if images != ImageStorage.NONE and camera_model != "rendered":
        raise RpojaxError.of_argument(
            "images", f"found {images.value!r} for camera.model = {camera_model!r}, expected 'none'"
        )
    return images


def bag_topics(image_storage: ImageStorage, has_pose: bool = False) -> list[Topic]:
    """Topics of a bag, in the order of the table; `has_pose` where the attitude of the target is estimated."""
    absent = {topics.IMAGE, topics.COMPRESSED_IMAGE} - {_IMAGE_TOPICS[image_storage]}
    absent |= set() if has_pose else {topics.TARGET_POSE}
    return [topic for topic in ALL_TOPICS if topic not in absent]


def team_topics(names: Sequence[str], image_storage: ImageStorage, has_pose: bool = False) -> list[Topic]:
    """Topics of a bag of a team, servicer by servicer; those that all have in common once."""
    own = bag_topics(image_storage, has_pose)
    return list(dict.fromkeys(namespaced_topics(name)[topic] for name in names for topic in own))


def bag_images(run: ReplayedRun[RosTickValues]) -> Iterator[np.ndarray]:
    """Images (p, p, 3), uint8 sRGB codes, of the rendered camera at every tick, rendered again."""
    return (image for image, _ in run_replay.rerendered_images(run, range(run.ticks)))


def _no_progress(done: int, total: int) -> None:
    """Default progress callback."""


def run_messages(
    run: ReplayedRun[RosTickValues],
    image_storage: ImageStorage,
    images: Iterable[np.ndarray] = (),
    on_progress: ProgressCallback = _no_progress,
) -> Iterator[TimedMessage]:
    """All messages of a run in the order of time; `images` has one for every tick, unless `image_storage` is none."""
    remaining_images = iter(images)
    for number in range(run.ticks):
        values = run.tick(number)
        time_ns = message_builders.nanoseconds(float(values.time_s))
        if number == 0:
            yield TimedMessage(time_ns, topics.TF_STATIC, message_builders.camera_transform(time_ns, values))
        for topic, build in tick_messages(values):
            yield TimedMessage(time_ns, topic, build())
        if image_storage == ImageStorage.RAW:
            yield TimedMessage(time_ns, topics.IMAGE, message_builders.image(time_ns, next(remaining_images)))
        elif image_storage == ImageStorage.COMPRESSED:
            message = message_builders.compressed_image(time_ns, next(remaining_images))
            yield TimedMessage(time_ns, topics.COMPRESSED_IMAGE, message)
        on_progress(number + 1, run.ticks)


def team_messages(
    runs: Sequence[ReplayedRun[RosTickValues]],
    image_storage: ImageStorage,
    images: Sequence[Iterable[np.ndarray]],
    on_progress: ProgressCallback = _no_progress,
) -> Iterator[TimedMessage]:
    """All messages of a run of a team in the order of time, with a namespace for each servicer."""
    streams = []
    for number, (run, own) in enumerate(zip(runs, images, strict=True)):
        assert run.servicer_name is not None
        messages = run_messages(run, image_storage, own, on_progress if number == 0 else _no_progress)
        renamed = namespaced_topics(run.servicer_name)
        streams.append(namespaced(messages, run.servicer_name, renamed, number == 0))
    return heapq.merge(_mountings(runs), *streams, key=lambda each: each.time_ns)


def _mountings(runs: Sequence[ReplayedRun[RosTickValues]]) -> Iterator[TimedMessage]:
    """Cameras of all servicers in one message: late subscribers get the last one of the topic, and it alone."""
    time_ns = message_builders.nanoseconds(float(runs[0].tick(0).time_s))
    found = [
        _renamed(message_builders.camera_transform(time_ns, run.tick(0)), run.servicer_name or "").transforms
        for run in runs
    ]
    yield TimedMessage(time_ns, topics.TF_STATIC, message_builders.tf_message([each for own in found for each in own]))


def provenance(run: ReplayedRun[RosTickValues]) -> dict[str, str]:
    """Custom metadata of a bag: version, scenario, seed and run."""
    return {
        "rpojax.version": __version__,
        "rpojax.scenario": run.file.name,
        "rpojax.scenario_hash": scenario_digest(run.file),
        "rpojax.precision": "double",
        "rpojax.seed": str(run.seed),
        "rpojax.run_id": str(run.run_id),
    }


def write_run(
    run: ReplayedRun[RosTickValues],
    out: Path,
    storage: BagFormat,
    image_storage: ImageStorage,
    force: bool,
    on_progress: ProgressCallback = _no_progress,
) -> int:
    """Writes a run into a bag and returns the number of messages.

    Raises:
        RpojaxError: rosbags is not installed, or the folder cannot be written.
    """
    images = () if image_storage == ImageStorage.NONE else bag_images(run)
    messages = run_messages(run, image_storage, images, on_progress)
    written = bag_topics(image_storage, run.values.target_pose is not None)
    return mcap_or_sqlite3_writer.write_bag(out, storage, written, messages, provenance(run), force)


def write_team(
    runs: Sequence[ReplayedRun[RosTickValues]],
    out: Path,
    storage: BagFormat,
    image_storage: ImageStorage,
    force: bool,
    on_progress: ProgressCallback = _no_progress,
) -> int:
    """Writes a run of a team into a bag with a namespace for each servicer, and returns the number of messages.

    Raises:
        RpojaxError: rosbags is not installed, or the folder cannot be written.
    """
    images = [() if image_storage == ImageStorage.NONE else bag_images(run) for run in runs]
    messages = team_messages(runs, image_storage, images, on_progress)
    names = [name for run in runs if (name := run.servicer_name)]
    content = {**provenance(runs[0]), "rpojax.servicers": ",".join(names)}
    written = team_topics(names, image_storage, runs[0].values.target_pose is not None)
    return mcap_or_sqlite3_writer.write_bag(out, storage, written, messages, content, force)
