"""Bags of a team: a namespace for each servicer, and what is the same for all once."""

import dataclasses

import numpy as np
import pytest

from rpojax.interop.ros2 import run_bag, topics
from rpojax.interop.ros2.mcap_or_sqlite3_writer import TimedMessage
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario.loading import scenario_loader

NAMES = ["first", "second"]


@pytest.fixture(scope="module")
def messages(burn_interval: ReplayedRun[RosTickValues], noise_images: np.ndarray) -> list[TimedMessage]:
    """Messages of two servicers that do the same."""
    file = scenario_loader.load("cooperative_far")
    runs = [dataclasses.replace(burn_interval, file=file, servicer=number) for number in range(2)]
    return list(run_bag.team_messages(runs, ImageStorage.RAW, [noise_images, noise_images]))


def test_each_servicer_has_its_own_topics_and_frames(messages: list[TimedMessage]) -> None:
    of_second = [each for each in messages if each.topic.name == "/second/servicer/truth/relative_odometry"]
    assert of_second
    assert all(each.message.header.frame_id == "hill" for each in of_second)
    assert all(each.message.child_frame_id == "second/servicer/base_link" for each in of_second)
    image = next(each for each in messages if each.topic.name == "/first/servicer/camera/image_raw")
    assert image.message.header.frame_id == "first/servicer/camera_optical_frame"
    found = [each for each in messages if each.topic.name == "/first/servicer/camera/detections"]
    frames = {part.header.frame_id for each in found for part in each.message.detections}
    assert frames == {"first/servicer/camera_optical_frame"}
    estimate = next(each for each in messages if each.topic.name == "/second/target/estimate/odometry")
    assert (estimate.message.header.frame_id, estimate.message.child_frame_id) == ("eci", "hill")


def test_what_is_the_same_for_all_is_there_once(
    messages: list[TimedMessage], burn_interval: ReplayedRun[RosTickValues]
) -> None:
    for topic in (topics.CLOCK, topics.TARGET_TRUTH):
        assert sum(each.topic is topic for each in messages) == burn_interval.ticks
    transforms = [part for each in messages if each.topic is topics.TF for part in each.message.transforms]
    children = [part.child_frame_id for part in transforms]
    for child in ("hill", "target/base_link", "first/servicer/base_link", "second/servicer/base_link"):
        assert children.count(child) == burn_interval.ticks
    [latched] = [each for each in messages if each.topic is topics.TF_STATIC]
    assert messages[0] is latched, "a late subscriber gets the last message of the topic, so there must be one for all"
    mountings = latched.message.transforms
    assert [(each.header.frame_id, each.child_frame_id) for each in mountings] == [
        (f"{name}/servicer/base_link", f"{name}/servicer/camera_optical_frame") for name in NAMES
    ]


def test_messages_are_in_the_order_of_time_on_declared_topics(messages: list[TimedMessage]) -> None:
    times = [each.time_ns for each in messages]
    assert times == sorted(times)
    declared = run_bag.team_topics(NAMES, ImageStorage.RAW)
    assert {each.topic for each in messages} <= set(declared)
    names = [each.name for each in declared]
    assert len(names) == len(set(names))
