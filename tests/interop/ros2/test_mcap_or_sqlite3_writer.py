"""Bags, read back by other libraries than the one that writes them."""

import dataclasses
import resource
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cyclonedds_decoder
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from ruamel.yaml import YAML

from rpojax.errors import OutputError, RpojaxError
from rpojax.interop.ros2 import mcap_or_sqlite3_writer, message_types, run_bag
from rpojax.interop.ros2.mcap_or_sqlite3_writer import BagFormat, TimedMessage
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.run_replay import ReplayedRun

SUFFIXES = {BagFormat.MCAP: ".mcap", BagFormat.SQLITE3: ".db3"}


def all_messages(
    ros_run: ReplayedRun[RosTickValues], images: ImageStorage, noise_images: np.ndarray
) -> list[TimedMessage]:
    """All messages of a run."""
    return list(run_bag.run_messages(ros_run, images, noise_images))


def write(
    out: Path,
    storage: BagFormat,
    ros_run: ReplayedRun[RosTickValues],
    images: ImageStorage,
    noise_images: np.ndarray,
    force: bool = False,
) -> Path:
    """Writes a bag of a run."""
    messages, bag_topics = run_bag.run_messages(ros_run, images, noise_images), run_bag.bag_topics(images)
    mcap_or_sqlite3_writer.write_bag(out, storage, bag_topics, messages, run_bag.provenance(ros_run), force)
    return out


def to_plain(message: Any) -> Any:
    """A message of any library as dictionaries, lists and numbers, with lower-case field names."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, bytes | bytearray | memoryview):
        return list(message)
    if isinstance(message, list | tuple):
        return [to_plain(each) for each in message]
    if isinstance(message, bool | int | float | str):
        return message
    if hasattr(message, "__msgtype__"):
        names = [name for name, _ in message_types.typestore().fielddefs[message.__msgtype__][1]]
    elif dataclasses.is_dataclass(message):
        names = [field.name for field in dataclasses.fields(message)]
    else:
        names = message.__slots__
    return {name.lower(): to_plain(getattr(message, name)) for name in names}


def by_mcap_ros2(bag: Path) -> Iterator[tuple[str, str, int, Any]]:
    """Topic, type, time and message, in the order of the file, as mcap_ros2 reads them."""
    for found in read_ros2_messages(str(bag / f"{bag.name}.mcap"), log_time_order=False):
        assert found.publish_time_ns == found.log_time_ns
        yield found.channel.topic, found.schema.name, found.log_time_ns, found.ros_msg


def by_sqlite_and_cyclonedds(bag: Path) -> Iterator[tuple[str, str, int, Any]]:
    """The same, as sqlite3 and cyclonedds read them."""
    with sqlite3.connect(f"file:{bag / bag.name}.db3?mode=ro", uri=True) as base:
        query = (
            "SELECT name, type, timestamp, data FROM messages JOIN topics ON topic_id = topics.id ORDER BY messages.id"
        )
        for name, kind, time, data in base.execute(query):
            yield name, kind, time, cyclonedds_decoder.message_class(kind).deserialize(data)


READERS = {BagFormat.MCAP: by_mcap_ros2, BagFormat.SQLITE3: by_sqlite_and_cyclonedds}


@pytest.mark.parametrize("storage", list(BagFormat))
def test_other_libraries_read_every_field_back(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path, storage: BagFormat
) -> None:
    images = ImageStorage.RAW if storage == BagFormat.MCAP else ImageStorage.COMPRESSED
    bag = write(tmp_path / "bag", storage, burn_interval, images, noise_images)
    written = all_messages(burn_interval, images, noise_images)
    read = list(READERS[storage](bag))
    assert {topic for topic, _, _, _ in read} == {topic.name for topic in run_bag.bag_topics(images)}
    assert [(each.topic.name, each.topic.type, each.time_ns) for each in written] == [entry[:3] for entry in read]
    for each, (name, _, _, message) in zip(written, read, strict=True):
        assert to_plain(message) == to_plain(each.message), name


@pytest.mark.parametrize("storage", list(BagFormat))
def test_the_same_run_exported_twice_gives_the_same_bytes(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path, storage: BagFormat
) -> None:
    bags = [
        write(tmp_path / place / "bag", storage, burn_interval, ImageStorage.COMPRESSED, noise_images)
        for place in ("one", "two")
    ]
    contents = [{path.name: path.read_bytes() for path in bag.iterdir()} for bag in bags]
    assert set(contents[0]) == {"metadata.yaml", f"bag{SUFFIXES[storage]}"}
    assert contents[0] == contents[1]


def metadata(bag: Path) -> dict[str, Any]:
    """Content of a bag's metadata."""
    return YAML(typ="safe").load(bag / "metadata.yaml")["rosbag2_bagfile_information"]


@pytest.mark.parametrize("storage", list(BagFormat))
def test_the_metadata_is_readable_from_humble_on(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path, storage: BagFormat
) -> None:
    found = metadata(write(tmp_path / "bag", storage, burn_interval, ImageStorage.NONE, noise_images))
    assert (found["version"], found["storage_identifier"]) == (8, storage.value)
    assert found["relative_file_paths"] == [f"bag{SUFFIXES[storage]}"]
    assert found["starting_time"]["nanoseconds_since_epoch"] == 112_000_000_000
    assert found["duration"]["nanoseconds"] == 64_000_000_000
    assert found["message_count"] == len(all_messages(burn_interval, ImageStorage.NONE, noise_images))
    entries = {each["topic_metadata"]["name"]: each for each in found["topics_with_message_count"]}
    assert list(entries) == [topic.name for topic in run_bag.bag_topics(ImageStorage.NONE)]
    assert entries["/tf_static"]["message_count"] == 1
    assert entries["/servicer/wheels/state"]["message_count"] == burn_interval.ticks
    for topic in run_bag.bag_topics(ImageStorage.NONE):
        entry = entries[topic.name]["topic_metadata"]
        assert entry["type_description_hash"] == message_types.type_hash(topic.type)
        # Humble takes a string that is YAML itself, with the enumeration values of rmw.
        [profile] = YAML(typ="safe").load(entry["offered_qos_profiles"])
        transient_local, volatile, keep_last, reliable = 1, 2, 1, 1
        assert profile["durability"] == (transient_local if topic.name == "/tf_static" else volatile)
        assert (profile["history"], profile["reliability"], profile["depth"]) == (keep_last, reliable, topic.qos.depth)
        assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert found["custom_data"]["rpojax.run_id"] == str(burn_interval.run_id)


def test_an_mcap_file_has_the_ros2_profile(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path
) -> None:
    bag = write(tmp_path / "bag", BagFormat.MCAP, burn_interval, ImageStorage.NONE, noise_images)
    with (bag / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary
    latched = next(channel for channel in summary.channels.values() if channel.topic == "/tf_static")
    assert "durability: 1" in latched.metadata["offered_qos_profiles"]
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}


def test_a_bag_is_overwritten_only_with_force(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path
) -> None:
    out = write(tmp_path / "bag", BagFormat.MCAP, burn_interval, ImageStorage.NONE, noise_images)
    with pytest.raises(OutputError, match=r"bag: exists already; force=True replaces it$"):
        write(out, BagFormat.SQLITE3, burn_interval, ImageStorage.NONE, noise_images)
    assert (out / "bag.mcap").exists()
    write(out, BagFormat.SQLITE3, burn_interval, ImageStorage.NONE, noise_images, force=True)
    assert sorted(path.name for path in out.iterdir()) == ["bag.db3", "metadata.yaml"]
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("inside", ["notes.txt", "metadata.yaml"])
def test_a_folder_that_is_no_bag_is_never_replaced(tmp_path: Path, inside: str) -> None:
    out = tmp_path / "mine"
    (out / "deeper").mkdir(parents=True)
    (out / inside).write_text("mine")
    with pytest.raises(OutputError, match=r"mine: found something that is no bag, expected a new folder$"):
        mcap_or_sqlite3_writer.check_output(out, force=True)


def test_an_unfinished_bag_is_removed_and_the_old_one_kept(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path
) -> None:
    out = write(tmp_path / "bag", BagFormat.MCAP, burn_interval, ImageStorage.NONE, noise_images)
    before = (out / "bag.mcap").read_bytes()

    def breaking() -> Iterator[np.ndarray]:
        yield from noise_images[:3]
        raise RpojaxError("no more pictures")

    messages, bag_topics = run_bag.run_messages(burn_interval, ImageStorage.RAW, breaking()), run_bag.bag_topics
    with pytest.raises(RpojaxError, match="no more pictures"):
        mcap_or_sqlite3_writer.write_bag(out, BagFormat.MCAP, bag_topics(ImageStorage.RAW), messages, {}, True)
    assert (out / "bag.mcap").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_an_unwritable_path_is_named(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/bag: found .*, expected room for a bag in a folder that can be writ"):
        write(tmp_path / "file" / "bag", BagFormat.MCAP, burn_interval, ImageStorage.NONE, noise_images)


@pytest.fixture
def small_file_limit() -> Iterator[None]:
    """Limits files to a few blocks, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_file_limit")
@pytest.mark.parametrize("storage", list(BagFormat))
def test_a_full_disk_is_one_error_line_and_leaves_nothing(
    burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray, tmp_path: Path, storage: BagFormat
) -> None:
    with pytest.raises(OutputError, match=r"^[^\n]*bag: found [^\n]*, expected room for a bag [^\n]*$"):
        write(tmp_path / "bag", storage, burn_interval, ImageStorage.RAW, noise_images)
    assert list(tmp_path.iterdir()) == []


def test_the_old_bag_is_kept_if_the_new_one_cannot_be_moved(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(OSError, match="No such file"):
        mcap_or_sqlite3_writer._replace_bag(tmp_path / "nowhere", tmp_path / "bag", tmp_path / "aside")
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
