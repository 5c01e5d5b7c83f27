"""Interface through which a live run gets its commands, and the stand-in that compiles the stages beforehand."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from rpojax.interop.cosimulation.command_input import NO_COMMAND
from rpojax.interop.cosimulation.odometry_input import orbit_estimate_from_odometry
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.tick_messages import TopicMessages
from rpojax.simulation.external_inputs import ExternalBurn, ExternalOrbitEstimate


@runtime_checkable
class CommandSource(Protocol):
    """Receiver of the messages of a run and source of its commands."""

    def publish(self, messages: TopicMessages) -> None:
        """Receives messages of the simulator."""
        ...

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate | None:
        """Orbit estimate for a tick [ns]."""
        ...

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """Burn command at a tick [ns]."""
        ...

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Wheel torques (3,) [N m] for a plant step [ns]."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Returns when the step that ends at a time [ns] may end."""
        ...


class WarmUpCommands:
    """Command source without external nodes: the simulator's own estimates, no burn and no torque."""

    def __init__(self) -> None:
        self._messages: dict[str, Any] = {}

    def publish(self, messages: TopicMessages) -> None:
        """Builds all messages and keeps the last of each topic."""
        self._messages |= {topic.name: build() for topic, build in messages}

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate:
        """Orbit estimate from the simulator's own odometry messages."""
        names = (topics.SERVICER_ESTIMATE.name, topics.RELATIVE_ESTIMATE.name)
        return orbit_estimate_from_odometry(*(self._messages[name] for name in names))

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """No command."""
        return NO_COMMAND

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Zero torque."""
        return np.zeros(3)

    def wait_until(self, time_ns: int) -> None:
        """Returns at once."""
