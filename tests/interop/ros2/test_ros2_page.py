"""The page on ROS 2 agrees with the code."""

import inspect
import re
from pathlib import Path

from rpojax.cli.options.output import ExportBagCommand
from rpojax.interop.ros2 import mcap_or_sqlite3_writer
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.ros2.topics import ALL_TOPICS, CAMERA, ECI, HILL, LATCHED_QOS, SERVICER, STREAM_QOS, TARGET

PAGE = (Path(__file__).parents[3] / "docs" / "how_to" / "ros2.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """Cells of the table under a heading, without its header."""
    text = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in text.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_page_lists_every_topic() -> None:
    expected = [
        [
            f"`{topic.name}`",
            f"`{topic.type.replace('/msg/', '/')}`",
            ", ".join(f"`{frame}`" for frame in (topic.frame_id, topic.child_frame_id) if frame),
            topic.source.value,
            topic.rate.value,
            topic.description,
        ]
        for topic in ALL_TOPICS
    ]
    assert rows("Topics") == expected


def test_the_page_lists_every_frame_id() -> None:
    frame_ids = [ECI, HILL, SERVICER, TARGET, CAMERA]
    assert [cells[0].strip("`") for cells in rows("Frames")] == frame_ids
    assert {each for topic in ALL_TOPICS for each in (topic.frame_id, topic.child_frame_id) if each} <= {*frame_ids}


def test_topic_names_are_distinct_and_absolute() -> None:
    names = [topic.name for topic in ALL_TOPICS]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"(/[a-z][a-z0-9_]*)+", name) for name in names)


def test_the_page_states_the_quality_of_service() -> None:
    assert f"reliable, volatile, keep last {STREAM_QOS.depth};" in PAGE
    assert f"transient local (latched), keep last {LATCHED_QOS.depth}." in PAGE
    assert {topic.name for topic in ALL_TOPICS if topic.qos.latched} == {"/tf_static"}
    assert f"`metadata.yaml` is of version {mcap_or_sqlite3_writer.METADATA_VERSION}:" in PAGE


def test_the_options_on_the_page_are_those_of_the_command() -> None:
    commands = [line for line in PAGE.splitlines() if line.startswith("rpojax export-bag")]
    used = set(re.findall(r"--([a-z][a-z-]*)", "\n".join(commands)))
    known = {name.replace("_", "-") for name in inspect.signature(ExportBagCommand).parameters}
    assert used <= known | {"format"}
    for kind in ImageStorage:
        assert f"`--images {kind.value}`" in PAGE
