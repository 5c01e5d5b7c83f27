"""Bags of any run: rosbag2 folders that `ros2 bag play` and Foxglove open, written without ROS.

Stamps and log times are simulation time, and nothing in a bag tells when or where it was written: the same run,
exported under the same name, gives the same bytes.
"""

import enum
import shutil
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.campaign.storage import atomic_files
from rpojax.errors import OutputError, RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.ros2 import message_builders, message_types, topics
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.topics import ALL_TOPICS, Qos, Topic
from rpojax.interop.run_replay import ReplayedRun
from rpojax.optional import require_package
from rpojax.scenario import scenario_file
from rpojax.version import __version__

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

ProgressCallback = Callable[[int, int], None]
"""Told how many ticks are written, of how many."""


def _no_progress(done: int, total: int) -> None:
    """Tells nobody."""


METADATA_VERSION = 8
"""Of `metadata.yaml`. Version 9 has its quality of service as a list, which Humble cannot read."""


class BagFormat(enum.StrEnum):
    """How a bag is stored."""

    MCAP = "mcap"
    SQLITE3 = "sqlite3"


class ImageStorage(enum.StrEnum):
    """What becomes of a rendered camera's pictures."""

    RAW = "raw"
    COMPRESSED = "compressed"
    NONE = "none"


@dataclass(frozen=True)
class TimedMessage:
    """A message with the topic and the time [ns] at which it is said."""

    time_ns: int
    topic: Topic
    message: Any


_IMAGE_TOPICS = {
    ImageStorage.RAW: topics.IMAGE,
    ImageStorage.COMPRESSED: topics.COMPRESSED_IMAGE,
    ImageStorage.NONE: None,
}


def resolve_image_storage(camera_model: str, requested: str) -> ImageStorage:
    """What becomes of the pictures of a camera of some model; `auto`: they are stored raw if there are any.

    Raises:
        RpojaxError: pictures are asked for, and the camera takes none.
    """
    automatic = ImageStorage.RAW if camera_model == "rendered" else ImageStorage.NONE
    wanted = automatic if requested == "auto" else ImageStorage(requested)
    if wanted != ImageStorage.NONE and camera_model != "rendered":
        raise RpojaxError(f"--images: found {wanted.value!r} for camera.model = {camera_model!r}, expected 'none'")
    return wanted


def bag_topics(images: ImageStorage) -> list[Topic]:
    """Topics of a bag, in the order of the table."""
    image_topic = _IMAGE_TOPICS[images]
    return [
        topic for topic in ALL_TOPICS if topic not in (topics.IMAGE, topics.COMPRESSED_IMAGE) or topic == image_topic
    ]


def rerendered_images(run: ReplayedRun[RosTickValues]) -> Iterator[np.ndarray]:
    """Pictures (p, p, 3), uint8 sRGB codes, that the rendered camera of a run took, one a tick, taken again."""
    return (picture for picture, _ in run_replay.rerendered_pictures(run, range(run.ticks)))


def run_messages(
    run: ReplayedRun[RosTickValues],
    images: ImageStorage,
    pictures: Iterable[np.ndarray] = (),
    on_progress: ProgressCallback = _no_progress,
) -> Iterator[TimedMessage]:
    """All messages of a run in the order of time; `taken` is a picture for every tick, unless `images` is none."""
    remaining_pictures = iter(pictures)
    for number in range(run.ticks):
        values = run.tick(number)
        time_ns = message_builders.nanoseconds(float(values.time_s))
        if number == 0:
            yield TimedMessage(time_ns, topics.TF_STATIC, message_builders.camera_transform(time_ns, values))
        for topic, build in message_builders.tick_messages(values):
            yield TimedMessage(time_ns, topic, build())
        if images == ImageStorage.RAW:
            yield TimedMessage(time_ns, topics.IMAGE, message_builders.image(time_ns, next(remaining_pictures)))
        elif images == ImageStorage.COMPRESSED:
            yield TimedMessage(
                time_ns, topics.COMPRESSED_IMAGE, message_builders.compressed_image(time_ns, next(remaining_pictures))
            )
        on_progress(number + 1, run.ticks)


def provenance(run: ReplayedRun[RosTickValues]) -> dict[str, str]:
    """What a bag says of where it comes from, beside its messages."""
    return {
        "rpojax.version": __version__,
        "rpojax.scenario": run.file.name,
        "rpojax.scenario_hash": scenario_file.digest(run.file),
        "rpojax.precision": "double",
        "rpojax.seed": str(run.seed),
        "rpojax.run_id": str(run.run_id),
    }


def check_output(out: Path, force: bool) -> None:
    """Checks that a bag can be put at `out`, before any work is done for it.

    Raises:
        OutputError: something is there, and it is no bag or `force` was not given.
    """
    if not out.name or out.is_symlink():
        raise OutputError(f"--out: found {str(out)!r}, expected the name of a folder")
    if not out.exists():
        return
    if not _is_bag(out):
        raise OutputError(f"{out}: found something that is no bag, expected a new folder")
    if not force:
        raise OutputError(f"{out}: exists already; --force replaces it")


def _is_bag(path: Path) -> bool:
    """Whether a folder holds a bag and nothing else."""
    if not path.is_dir() or not (path / "metadata.yaml").is_file():
        return False
    return all(entry.name == "metadata.yaml" or entry.suffix in (".mcap", ".db3") for entry in path.iterdir())


def write_run(
    run: ReplayedRun[RosTickValues],
    out: Path,
    storage: BagFormat,
    images: ImageStorage,
    force: bool,
    on_progress: ProgressCallback = _no_progress,
) -> int:
    """Writes a run into a bag and returns the number of messages; `on_tick` is told `(done, total)`.

    Raises:
        RpojaxError: rosbags is not installed, or there cannot be such a folder.
    """
    pictures = () if images == ImageStorage.NONE else rerendered_images(run)
    return write_bag(
        out, storage, bag_topics(images), run_messages(run, images, pictures, on_progress), provenance(run), force
    )


def write_bag(
    out: Path,
    storage: BagFormat,
    bag_topics: Sequence[Topic],
    messages: Iterable[TimedMessage],
    custom_data: dict[str, str],
    force: bool,
) -> int:
    """Writes messages on some topics into a bag and returns how many; there is a whole bag, or none.

    Raises:
        RpojaxError: rosbags is not installed, or there cannot be such a folder.
    """
    check_output(out, force)
    temporary = out.parent / atomic_files.partial_name(out.name)
    try:
        (temporary / "new").mkdir(parents=True)
        count = _write_messages(temporary / "new" / out.name, storage, bag_topics, messages, custom_data)
        _replace_bag(temporary / "new" / out.name, out, temporary / "old")
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{out}: found {reason}, expected room for a bag in a folder that can be written") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return count


def _replace_bag(new: Path, out: Path, backup: Path) -> None:
    """Renames a whole bag to its name; the one that is there goes, or stays if that fails."""
    if out.exists():
        out.rename(backup)
    try:
        new.rename(out)
    except OSError:
        if backup.exists():
            backup.rename(out)
        raise


def _write_messages(
    out: Path,
    storage: BagFormat,
    bag_topics: Sequence[Topic],
    messages: Iterable[TimedMessage],
    custom_data: dict[str, str],
) -> int:
    rosbag2 = require_package("rosbags.rosbag2", "ros")
    plugin = {BagFormat.MCAP: rosbag2.StoragePlugin.MCAP, BagFormat.SQLITE3: rosbag2.StoragePlugin.SQLITE3}[storage]
    writer = rosbag2.Writer(out, version=METADATA_VERSION, storage_plugin=plugin)
    for key, value in custom_data.items():
        writer.set_custom_data(key, value)
    count = 0
    with writer:
        connections = {topic: _add_connection(writer, topic) for topic in bag_topics}
        for each in messages:
            writer.write(connections[each.topic], each.time_ns, message_types.serialize(each.message))
            count += 1
    return count


def _add_connection(writer: "Writer", topic: Topic) -> Any:
    return writer.add_connection(
        topic.name,
        topic.type,
        msgdef=message_types.definition(topic.type),
        rihs01=message_types.type_hash(topic.type),
        offered_qos_profiles=[_qos_profile(topic.qos)],
    )


def _qos_profile(qos: Qos) -> Any:
    """A reliable publisher's profile as rosbags has it; times without limit, as ROS 2 writes them."""
    rosbags_types = require_package("rosbags.interfaces", "ros")
    unlimited = rosbags_types.QosTime(
        sec=_UNLIMITED_NS // message_builders.NANOSECONDS_PER_S, nsec=_UNLIMITED_NS % message_builders.NANOSECONDS_PER_S
    )
    return rosbags_types.Qos(
        history=rosbags_types.QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=rosbags_types.QosReliability.RELIABLE,
        durability=rosbags_types.QosDurability.TRANSIENT_LOCAL if qos.latched else rosbags_types.QosDurability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=rosbags_types.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )


_UNLIMITED_NS = 2**63 - 1
"""Nanoseconds that ROS 2 takes for no limit."""
