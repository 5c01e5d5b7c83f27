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
from rpojax.interop.ros2.message_values import TickValues
from rpojax.interop.ros2.topics import TABLE, Qos, Topic
from rpojax.interop.run_replay import Flight
from rpojax.optional import need
from rpojax.scenario import scenario_file
from rpojax.version import __version__

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

Told = Callable[[int, int], None]
"""Told how many ticks are written, of how many."""


def _nobody(done: int, total: int) -> None:
    """Tells nobody."""


METADATA_VERSION = 8
"""Of `metadata.yaml`. Version 9 has its quality of service as a list, which Humble cannot read."""


class Format(enum.StrEnum):
    """How a bag is stored."""

    MCAP = "mcap"
    SQLITE3 = "sqlite3"


class Images(enum.StrEnum):
    """What becomes of a rendered camera's pictures."""

    RAW = "raw"
    COMPRESSED = "compressed"
    NONE = "none"


@dataclass(frozen=True)
class Stamped:
    """A message with the topic and the time [ns] at which it is said."""

    nanos: int
    topic: Topic
    message: Any


_IMAGE_TOPICS = {Images.RAW: topics.IMAGE, Images.COMPRESSED: topics.COMPRESSED_IMAGE, Images.NONE: None}


def images_of(model: str, asked: str) -> Images:
    """What becomes of the pictures of a camera of some model; `auto`: they are stored raw if there are any.

    Raises:
        RpojaxError: pictures are asked for, and the camera takes none.
    """
    automatic = Images.RAW if model == "rendered" else Images.NONE
    wanted = automatic if asked == "auto" else Images(asked)
    if wanted != Images.NONE and model != "rendered":
        raise RpojaxError(f"--images: found {wanted.value!r} for camera.model = {model!r}, expected 'none'")
    return wanted


def topics_of(images: Images) -> list[Topic]:
    """Topics of a bag, in the order of the table."""
    wanted = _IMAGE_TOPICS[images]
    return [topic for topic in TABLE if topic not in (topics.IMAGE, topics.COMPRESSED_IMAGE) or topic == wanted]


def pictures(flight: Flight[TickValues]) -> Iterator[np.ndarray]:
    """Pictures (p, p, 3), uint8 sRGB codes, that the rendered camera of a run took, one a tick, taken again."""
    return (picture for picture, _ in run_replay.pictures(flight, range(flight.ticks)))


def said(
    flight: Flight[TickValues], images: Images, taken: Iterable[np.ndarray] = (), on_tick: Told = _nobody
) -> Iterator[Stamped]:
    """All messages of a run in the order of time; `taken` is a picture for every tick, unless `images` is none."""
    shots = iter(taken)
    for number in range(flight.ticks):
        values = flight.tick(number)
        nanos = message_builders.nanoseconds(float(values.time_s))
        if number == 0:
            yield Stamped(nanos, topics.TF_STATIC, message_builders.camera_mounting(nanos, values))
        for topic, make in message_builders.of_tick(values):
            yield Stamped(nanos, topic, make())
        if images == Images.RAW:
            yield Stamped(nanos, topics.IMAGE, message_builders.image(nanos, next(shots)))
        elif images == Images.COMPRESSED:
            yield Stamped(nanos, topics.COMPRESSED_IMAGE, message_builders.compressed_image(nanos, next(shots)))
        on_tick(number + 1, flight.ticks)


def origin(flight: Flight[TickValues]) -> dict[str, str]:
    """What a bag says of where it comes from, beside its messages."""
    return {
        "rpojax.version": __version__,
        "rpojax.scenario": flight.file.name,
        "rpojax.scenario_hash": scenario_file.digest(flight.file),
        "rpojax.precision": "double",
        "rpojax.seed": str(flight.seed),
        "rpojax.run_id": str(flight.run_id),
    }


def claim(out: Path, force: bool) -> None:
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


def export(
    flight: Flight[TickValues], out: Path, form: Format, images: Images, force: bool, on_tick: Told = _nobody
) -> int:
    """Writes a run into a bag and returns the number of messages; `on_tick` is told `(done, total)`.

    Raises:
        RpojaxError: rosbags is not installed, or there cannot be such a folder.
    """
    taken = () if images == Images.NONE else pictures(flight)
    return write(out, form, topics_of(images), said(flight, images, taken, on_tick), origin(flight), force)


def write(
    out: Path, form: Format, carried: Sequence[Topic], said: Iterable[Stamped], custom: dict[str, str], force: bool
) -> int:
    """Writes messages on some topics into a bag and returns how many; there is a whole bag, or none.

    Raises:
        RpojaxError: rosbags is not installed, or there cannot be such a folder.
    """
    claim(out, force)
    partial = out.parent / atomic_files.partial_name(out.name)
    try:
        (partial / "new").mkdir(parents=True)
        count = _write(partial / "new" / out.name, form, carried, said, custom)
        _put_in_place(partial / "new" / out.name, out, partial / "old")
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{out}: found {reason}, expected room for a bag in a folder that can be written") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return count


def _put_in_place(made: Path, out: Path, aside: Path) -> None:
    """Renames a whole bag to its name; the one that is there goes, or stays if that fails."""
    if out.exists():
        out.rename(aside)
    try:
        made.rename(out)
    except OSError:
        if aside.exists():
            aside.rename(out)
        raise


def _write(out: Path, form: Format, carried: Sequence[Topic], said: Iterable[Stamped], custom: dict[str, str]) -> int:
    rosbag2 = need("rosbags.rosbag2", "ros")
    plugin = {Format.MCAP: rosbag2.StoragePlugin.MCAP, Format.SQLITE3: rosbag2.StoragePlugin.SQLITE3}[form]
    writer = rosbag2.Writer(out, version=METADATA_VERSION, storage_plugin=plugin)
    for key, value in custom.items():
        writer.set_custom_data(key, value)
    count = 0
    with writer:
        places = {topic: _add(writer, topic) for topic in carried}
        for each in said:
            writer.write(places[each.topic], each.nanos, message_types.serialize(each.message))
            count += 1
    return count


def _add(writer: "Writer", topic: Topic) -> Any:
    return writer.add_connection(
        topic.name,
        topic.type,
        msgdef=message_types.definition(topic.type),
        rihs01=message_types.type_hash(topic.type),
        offered_qos_profiles=[_profile(topic.qos)],
    )


def _profile(qos: Qos) -> Any:
    """A reliable publisher's profile as rosbags has it; times without limit, as ROS 2 writes them."""
    kinds = need("rosbags.interfaces", "ros")
    forever = kinds.QosTime(sec=_FOREVER // message_builders.NANO, nsec=_FOREVER % message_builders.NANO)
    return kinds.Qos(
        history=kinds.QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=kinds.QosReliability.RELIABLE,
        durability=kinds.QosDurability.TRANSIENT_LOCAL if qos.latched else kinds.QosDurability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=kinds.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


_FOREVER = 2**63 - 1
"""Nanoseconds that ROS 2 takes for no limit."""
