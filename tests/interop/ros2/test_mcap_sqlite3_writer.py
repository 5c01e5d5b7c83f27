"""Bags, read back by other libraries than the one that wrote them."""

import dataclasses
import resource
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import cyclonedds_decoder
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from ruamel.yaml import YAML

from rpojax.errors import OutputError, RpojaxError
from rpojax.interop.ros2 import mcap_sqlite3_writer, message_types, topics
from rpojax.interop.ros2.mcap_sqlite3_writer import BagFormat, ImageStorage, TimedMessage
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun

STORED = {BagFormat.MCAP: ".mcap", BagFormat.SQLITE3: ".db3"}


def everything(flight: ReplayedRun[RosTickValues], images: ImageStorage, shots: np.ndarray) -> list[TimedMessage]:
    """All messages of a flight."""
    return list(mcap_sqlite3_writer.run_messages(flight, images, shots))


def make(
    out: Path,
    form: BagFormat,
    flight: ReplayedRun[RosTickValues],
    images: ImageStorage,
    shots: np.ndarray,
    force: bool = False,
) -> Path:
    """A bag of a flight."""
    told = mcap_sqlite3_writer.run_messages(flight, images, shots)
    mcap_sqlite3_writer.write_bag(
        out, form, mcap_sqlite3_writer.bag_topics(images), told, mcap_sqlite3_writer.provenance(flight), force
    )
    return out


def plain(message: Any) -> Any:
    """A message of any library as dictionaries, lists and numbers, with names of fields in lower case."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, bytes | bytearray | memoryview):
        return list(message)
    if isinstance(message, list | tuple):
        return [plain(each) for each in message]
    if isinstance(message, bool | int | float | str):
        return message
    if hasattr(message, "__msgtype__"):
        names = [name for name, _ in message_types.typestore().fielddefs[message.__msgtype__][1]]
    elif dataclasses.is_dataclass(message):
        names = [field.name for field in dataclasses.fields(message)]
    else:
        names = message.__slots__
    return {name.lower(): plain(getattr(message, name)) for name in names}


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


@pytest.mark.parametrize("form", list(BagFormat))
def test_other_libraries_read_every_field_as_it_was_written(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path, form: BagFormat
) -> None:
    images = ImageStorage.RAW if form == BagFormat.MCAP else ImageStorage.COMPRESSED
    bag = make(tmp_path / "bag", form, around_burn, images, shots)
    written = everything(around_burn, images, shots)
    read = list(READERS[form](bag))
    assert {topic for topic, _, _, _ in read} == {topic.name for topic in mcap_sqlite3_writer.bag_topics(images)}
    assert [(each.topic.name, each.topic.type, each.time_ns) for each in written] == [entry[:3] for entry in read]
    for each, (name, _, _, message) in zip(written, read, strict=True):
        assert plain(message) == plain(each.message), name


@pytest.mark.parametrize("form", list(BagFormat))
def test_the_same_run_exported_twice_gives_the_same_bytes(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path, form: BagFormat
) -> None:
    bags = [
        make(tmp_path / place / "bag", form, around_burn, ImageStorage.COMPRESSED, shots) for place in ("one", "two")
    ]
    contents = [{path.name: path.read_bytes() for path in bag.iterdir()} for bag in bags]
    assert set(contents[0]) == {"metadata.yaml", f"bag{STORED[form]}"}
    assert contents[0] == contents[1]


def described(bag: Path) -> dict[str, Any]:
    """Content of a bag's metadata."""
    return YAML(typ="safe").load(bag / "metadata.yaml")["rosbag2_bagfile_information"]


@pytest.mark.parametrize("form", list(BagFormat))
def test_the_metadata_can_be_read_from_humble_on(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path, form: BagFormat
) -> None:
    found = described(make(tmp_path / "bag", form, around_burn, ImageStorage.NONE, shots))
    assert (found["version"], found["storage_identifier"]) == (8, form.value)
    assert found["relative_file_paths"] == [f"bag{STORED[form]}"]
    assert found["starting_time"]["nanoseconds_since_epoch"] == 112_000_000_000
    assert found["duration"]["nanoseconds"] == 64_000_000_000
    assert found["message_count"] == len(everything(around_burn, ImageStorage.NONE, shots))
    entries = {each["topic_metadata"]["name"]: each for each in found["topics_with_message_count"]}
    assert list(entries) == [topic.name for topic in mcap_sqlite3_writer.bag_topics(ImageStorage.NONE)]
    assert entries["/tf_static"]["message_count"] == 1
    assert entries["/servicer/wheels/state"]["message_count"] == around_burn.ticks
    for topic in mcap_sqlite3_writer.bag_topics(ImageStorage.NONE):
        entry = entries[topic.name]["topic_metadata"]
        assert entry["type_description_hash"] == message_types.type_hash(topic.type)
        # Humble takes a string that is YAML itself, with the numbers of rmw.
        [profile] = YAML(typ="safe").load(entry["offered_qos_profiles"])
        transient_local, volatile, keep_last, reliable = 1, 2, 1, 1
        assert profile["durability"] == (transient_local if topic.name == "/tf_static" else volatile)
        assert (profile["history"], profile["reliability"], profile["depth"]) == (keep_last, reliable, topic.qos.depth)
        assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert found["custom_data"]["rpojax.run_id"] == str(around_burn.run_id)


def test_an_mcap_file_says_that_it_is_a_bag_of_ros_2(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path
) -> None:
    bag = make(tmp_path / "bag", BagFormat.MCAP, around_burn, ImageStorage.NONE, shots)
    with (bag / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary
    latched = next(channel for channel in summary.channels.values() if channel.topic == "/tf_static")
    assert "durability: 1" in latched.metadata["offered_qos_profiles"]
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}


def test_a_compressed_picture_is_the_picture(around_burn: ReplayedRun[RosTickValues], shots: np.ndarray) -> None:
    told = everything(around_burn, ImageStorage.COMPRESSED, shots)
    packed = [each.message for each in told if each.topic is topics.COMPRESSED_IMAGE]
    assert len(packed) == around_burn.ticks
    for message, shot in zip(packed, shots, strict=True):
        assert message.format == "rgb8; png compressed bgr8"
        np.testing.assert_array_equal(cv2.imdecode(message.data, cv2.IMREAD_COLOR)[:, :, ::-1], shot)


def test_a_bag_is_not_overwritten_unless_asked(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path
) -> None:
    out = make(tmp_path / "bag", BagFormat.MCAP, around_burn, ImageStorage.NONE, shots)
    with pytest.raises(OutputError, match=r"bag: exists already; --force replaces it$"):
        make(out, BagFormat.SQLITE3, around_burn, ImageStorage.NONE, shots)
    assert (out / "bag.mcap").exists()
    make(out, BagFormat.SQLITE3, around_burn, ImageStorage.NONE, shots, force=True)
    assert sorted(path.name for path in out.iterdir()) == ["bag.db3", "metadata.yaml"]
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("inside", ["notes.txt", "metadata.yaml"])
def test_what_is_no_bag_is_never_replaced(tmp_path: Path, inside: str) -> None:
    out = tmp_path / "mine"
    (out / "deeper").mkdir(parents=True)
    (out / inside).write_text("mine")
    with pytest.raises(OutputError, match=r"mine: found something that is no bag, expected a new folder$"):
        mcap_sqlite3_writer.check_output(out, force=True)


def test_a_bag_that_cannot_be_finished_leaves_nothing_and_the_old_one_alone(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path
) -> None:
    out = make(tmp_path / "bag", BagFormat.MCAP, around_burn, ImageStorage.NONE, shots)
    before = (out / "bag.mcap").read_bytes()

    def breaking() -> Iterator[np.ndarray]:
        yield from shots[:3]
        raise RpojaxError("no more pictures")

    told = mcap_sqlite3_writer.run_messages(around_burn, ImageStorage.RAW, breaking())
    with pytest.raises(RpojaxError, match="no more pictures"):
        mcap_sqlite3_writer.write_bag(
            out, BagFormat.MCAP, mcap_sqlite3_writer.bag_topics(ImageStorage.RAW), told, {}, True
        )
    assert (out / "bag.mcap").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_a_place_that_cannot_be_written_to_is_named(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/bag: found .*, expected room for a bag in a folder that can be writ"):
        make(tmp_path / "file" / "bag", BagFormat.MCAP, around_burn, ImageStorage.NONE, shots)


@pytest.fixture
def little_room() -> Iterator[None]:
    """No file may grow beyond a few blocks, as if the disk were full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("little_room")
@pytest.mark.parametrize("form", list(BagFormat))
def test_a_full_disk_is_said_in_one_line_and_leaves_nothing(
    around_burn: ReplayedRun[RosTickValues], shots: np.ndarray, tmp_path: Path, form: BagFormat
) -> None:
    with pytest.raises(OutputError, match=r"^[^\n]*bag: found [^\n]*, expected room for a bag [^\n]*$"):
        make(tmp_path / "bag", form, around_burn, ImageStorage.RAW, shots)
    assert list(tmp_path.iterdir()) == []


def test_the_old_bag_stays_if_the_new_one_cannot_take_its_place(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(OSError, match="No such file"):
        mcap_sqlite3_writer._replace_bag(tmp_path / "nowhere", tmp_path / "bag", tmp_path / "aside")
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_pictures_of_a_camera_that_takes_none_are_refused() -> None:
    assert mcap_sqlite3_writer.resolve_image_storage("geometric", "auto") == ImageStorage.NONE
    assert mcap_sqlite3_writer.resolve_image_storage("rendered", "auto") == ImageStorage.RAW
    with pytest.raises(RpojaxError, match=r"^--images: found 'raw' for camera.model = 'geometric', expected 'none'$"):
        mcap_sqlite3_writer.resolve_image_storage("geometric", "raw")
