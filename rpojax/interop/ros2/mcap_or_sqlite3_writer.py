"""Writer of rosbag2 bags in MCAP or SQLite3 storage, without a ROS installation.

A bag is a folder that `ros2 bag play` and Foxglove open. Log times are simulation time and nothing tells when or where
the bag was written, so the same messages under the same name give the same bytes.
"""

import enum
import shutil
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpojax.campaign.storage import atomic_files
from rpojax.errors import OutputError
from rpojax.interop.ros2 import message_builders, message_types
from rpojax.interop.ros2.topics import Qos, Topic
from rpojax.optional_packages import require_package

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

METADATA_VERSION = 8
"""Of `metadata.yaml`. Version 9 stores quality of service as a list, which Humble cannot read."""

_UNLIMITED_NS = 2**63 - 1
"""Nanoseconds that ROS 2 takes for no limit."""


class BagFormat(enum.StrEnum):
    """Storage of a bag."""

    MCAP = "mcap"
    SQLITE3 = "sqlite3"


@dataclass(frozen=True)
class TimedMessage:
    """A message with its topic and log time [ns]."""

    time_ns: int
    topic: Topic
    message: Any


def check_output(out: Path, force: bool) -> None:
    """Checks that a bag can be written to `out`, before any work is done for it.

    Raises:
        OutputError: `out` exists, and is no bag or `force` was not given.
    """
    if not out.name or out.is_symlink():
        raise OutputError.of_argument("out", f"found {str(out)!r}, expected the name of a folder")
    if not out.exists():
        return
    if not _is_bag(out):
        raise OutputError(f"{out}: found something that is no bag, expected a new folder")
    if not force:
        raise OutputError(f"{out}: exists already; force=True replaces it")


def _is_bag(path: Path) -> bool:
    """Whether a folder holds a bag and nothing else."""
    if not path.is_dir() or not (path / "metadata.yaml").is_file():
        return False
    return all(entry.name == "metadata.yaml" or entry.suffix in (".mcap", ".db3") for entry in path.iterdir())


def write_bag(
    out: Path,
    storage: BagFormat,
    topics: Sequence[Topic],
    messages: Iterable[TimedMessage],
    custom_data: dict[str, str],
    force: bool,
) -> int:
    """Writes messages into a bag and returns their number; on an error no partial bag remains.

    Raises:
        RpojaxError: rosbags is not installed, or the folder cannot be written.
    """
    check_output(out, force)
    temporary = out.parent / atomic_files.partial_name(out.name)
    try:
        (temporary / "new").mkdir(parents=True)
        count = _write_messages(temporary / "new" / out.name, storage, topics, messages, custom_data)
        _replace_bag(temporary / "new" / out.name, out, temporary / "old")
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{out}: found {reason}, expected room for a bag in a folder that can be written") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return count


def _replace_bag(new: Path, out: Path, backup: Path) -> None:
    """Moves a finished bag to its name; an old bag there is removed, or kept if that fails."""
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
    topics: Sequence[Topic],
    messages: Iterable[TimedMessage],
    custom_data: dict[str, str],
) -> int:
    rosbag2 = require_package("rosbags.rosbag2")
    plugins = rosbag2.StoragePlugin
    plugin = {BagFormat.MCAP: plugins.MCAP, BagFormat.SQLITE3: plugins.SQLITE3}[storage]
    writer = rosbag2.Writer(out, version=METADATA_VERSION, storage_plugin=plugin)
    for key, value in custom_data.items():
        writer.set_custom_data(key, value)
    count = 0
    with writer:
        connections = {topic: _add_connection(writer, topic) for topic in topics}
        for timed in messages:
            writer.write(connections[timed.topic], timed.time_ns, message_types.serialize(timed.message))
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
    """Quality of service of a reliable publisher as rosbags has it, with unlimited times as ROS 2 writes them."""
    rosbags_types = require_package("rosbags.interfaces")
    seconds, nanoseconds = divmod(_UNLIMITED_NS, message_builders.NANOSECONDS_PER_S)
    unlimited = rosbags_types.QosTime(sec=seconds, nsec=nanoseconds)
    durability = rosbags_types.QosDurability
    return rosbags_types.Qos(
        history=rosbags_types.QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=rosbags_types.QosReliability.RELIABLE,
        durability=durability.TRANSIENT_LOCAL if qos.latched else durability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=rosbags_types.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )
