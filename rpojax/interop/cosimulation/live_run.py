"""A run flown live: it says what it senses, and leaves some of its flight software to whoever answers."""

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import jax
import numpy as np

from rpojax.campaign import single_run
from rpojax.core.array_packing import PackedRecord
from rpojax.errors import UnfinishedError
from rpojax.interop.cosimulation.clock import LockstepClock, RealTimeClock
from rpojax.interop.cosimulation.command_checks import CommandLimits
from rpojax.interop.cosimulation.command_input import NO_BURN, CommandInput
from rpojax.interop.cosimulation.compiled_stages import CompiledStages, PackedTick
from rpojax.interop.cosimulation.event_log import EventLog, LineWriter
from rpojax.interop.cosimulation.live_publisher import TickMessages
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings
from rpojax.interop.cosimulation.message_exchange import MessageExchange
from rpojax.interop.cosimulation.odometry_input import orbit_estimate_from_odometry
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import TopicMessages, nanoseconds
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop, metrics
from rpojax.simulation.closed_loop import FAILURE_REASONS
from rpojax.simulation.external_stages import BurnDecider, ExternalBurn, ExternalOrbitEstimate
from rpojax.simulation.telemetry import Channels


@dataclass(frozen=True)
class LiveRunResult:
    """What came of a live run.

    Attributes:
        ticks: flown
        steps: of the plant
        completed: it was flown to its end
        failure: why the run failed, "" if it did not
        stopped: why it was not flown to its end, "" if it was, or failed
        metrics: of a completed run
        ledger: what went wrong
        sent: messages by topic
        received: messages by topic
        unsent: messages that a subscriber was too slow for
        simulated_s: time flown
        wall_s: time that it took
        cpu_s: time that this process worked for it
        lag_s: by how much a run in real time was behind at worst
    """

    ticks: int
    steps: int
    completed: bool
    failure: str
    stop_reason: str
    metrics: Mapping[str, float]
    events: EventLog
    sent: Mapping[str, int]
    received: Mapping[str, int]
    unsent: int
    simulated_s: float
    wall_s: float
    cpu_s: float
    lag_s: float


def simulate_live(
    file: ScenarioFile, seed: int, run_id: int, settings: LiveSettings, write_line: LineWriter
) -> LiveRunResult:
    """Flies one run live; `tell` gets lines on what happens.

    Raises:
        RpojaxError: the domain cannot be joined, or nobody came.
    """
    events = EventLog(write_line)
    exchange = MessageExchange(settings.domain_id, settings.published_topics, settings.command_topics, events)
    write_line("compiling")
    run = _LiveRun(file, seed, run_id, settings)
    run.warm_up()
    write_line("waiting for the other side")
    exchange.wait_for_nodes(settings.wait_s)
    write_line("flying")
    # What is here by now stays to the end: there is no use in going through it for garbage again and again.
    gc.collect()
    gc.freeze()
    clock: LockstepClock | RealTimeClock = LockstepClock(settings.timeout_s)
    if settings.real_time_factor is not None:
        clock = RealTimeClock(settings.real_time_factor, nanoseconds(run.scenario.step_s), settings.timeout_s)
    commands = CommandInput(settings, run.limits, exchange, clock, events)
    wall, cpu, stop_reason = time.perf_counter(), time.process_time(), ""
    try:
        while run.is_running:
            exchange.count_type_mismatches()
            run.tick(commands)
    except UnfinishedError as error:
        stop_reason = str(error)
    finally:
        gc.unfreeze()
    return LiveRunResult(
        ticks=run.ticks,
        steps=run.ticks * run.scenario.substeps,
        completed=run.completed,
        failure=run.failure,
        stop_reason=stop_reason,
        metrics=run.metrics(),
        events=events,
        sent=exchange.sent,
        received=exchange.received,
        unsent=exchange.unsent,
        simulated_s=run.ticks * run.scenario.tick_s,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        lag_s=clock.lag_s if isinstance(clock, RealTimeClock) else 0.0,
    )


class _LiveRun:
    """The run, where it is, and what is recorded of it."""

    def __init__(self, file: ScenarioFile, seed: int, run_id: int, settings: LiveSettings) -> None:
        self._file, self._external_stages = file, settings.external_stages
        self.scenario, self._params, key = single_run.dispersed_parameters(file, seed, run_id)
        self._stages = CompiledStages(self.scenario, self._params)
        start = jax.jit(closed_loop.init, static_argnums=0)(self.scenario, self._params, key)
        self._tick = self._stages.first_tick(start)
        self._messages = TickMessages(settings, nanoseconds(self.scenario.step_s))
        self._sends_images = settings.pictures and self.scenario.camera_model == "rendered"
        self._records: dict[str, np.ndarray] = {}
        self.ticks = 0
        self.failure = ""

    @property
    def limits(self) -> CommandLimits:
        """Of commands, by the vehicle's own data base."""
        vehicle, pointing = self._params.flight.vehicle, self._params.flight.pointing
        return CommandLimits(
            torque=np.asarray(vehicle.wheel_torque_limit),
            minimum_on_time_s=float(vehicle.minimum_on_time),
            maximum_on_time_s=float(pointing.look_away_limit),
        )

    @property
    def completed(self) -> bool:
        """The run was flown to its end."""
        return self.ticks == self.scenario.ticks and not self.failure

    @property
    def is_running(self) -> bool:
        """The run is neither over nor has it failed."""
        return self.ticks < self.scenario.ticks and not self.failure

    def warm_up(self) -> None:
        """Flies some ticks in every way that may be asked for, so that all is compiled; nothing comes of it."""
        start = self._tick
        deciders: tuple[BurnDecider, ...] = (
            ("given", "nobody") if ExternalStage.FORMATION in self._external_stages else ("own",)
        )
        for decider in deciders:
            self._tick = self._simulate_tick(_WarmUpCommands(decider), lambda _: None)
        self._tick = start

    def tick(self, commands: "CommandSource") -> None:
        """Flies one tick."""
        self._tick = self._simulate_tick(commands, self._record)
        self.failure = FAILURE_REASONS[self._tick.failure]
        self.ticks += 1

    def _record(self, channels: Channels) -> None:
        for name, value in channels.items():
            if name not in self._records:
                self._records[name] = np.zeros((1, self.scenario.ticks, *value.shape), dtype=value.dtype)
            self._records[name][0, self.ticks] = value

    def metrics(self) -> dict[str, float]:
        """Figures of merit of a completed run, none of another."""
        if not self.completed:
            return {}
        return {name: float(values[0]) for name, values in metrics.evaluate(self._file, self._records).items()}

    def _simulate_tick(self, commands: "CommandSource", record: Callable[[Channels], None]) -> PackedTick:
        """The next tick, after this one is recorded: what is said may be answered before the next is done."""
        tick, stages, time_ns = self._tick, self._stages, self._step_start_ns(0)
        commands.publish(self._messages.after_navigation(tick.values))
        if self._sends_images:
            commands.publish(self._messages.camera_image(time_ns, partial(stages.camera_image, tick)))
        if (
            ExternalStage.NAVIGATION in self._external_stages
            and (estimate := commands.orbit_estimate(time_ns)) is not None
        ):
            tick = stages.with_orbit_estimate(tick, estimate)
        decider, burn = (
            commands.burn_command(time_ns) if ExternalStage.FORMATION in self._external_stages else ("own", NO_BURN)
        )
        guided, motion, values = stages.plan_and_guide(decider, tick, burn)
        commands.publish(self._messages.attitude_reference(values, tick.values))

        def aside() -> None:
            commands.publish(self._messages.after_guidance(values))
            record(values.channels)

        return self._propagate_tick(commands, tick, guided, motion, aside)

    def _propagate_tick(
        self,
        commands: "CommandSource",
        tick: PackedTick,
        guided: PackedRecord,
        motion: PackedRecord,
        publish_and_record: Callable[[], None],
    ) -> PackedTick:
        """The next tick, after the plant steps of this one; `aside` is done as soon as the other side has to think."""
        last = self.scenario.substeps - 1
        if ExternalStage.ATTITUDE not in self._external_stages:
            publish_and_record()
            next_tick = self._stages.all_plant_steps(tick, guided)
            commands.wait_until(self._step_start_ns(last + 1))
            return next_tick
        for step in range(last):
            motion, attitude = self._stages.plant_step(
                tick, guided, motion, commands.wheel_torque(self._step_start_ns(step)), step
            )
            commands.wait_until(self._step_start_ns(step + 1))
            commands.publish(self._messages.plant_step(self._step_start_ns(step + 1), attitude))
            if step == 0:
                publish_and_record()
        if last == 0:
            publish_and_record()
        next_tick = self._stages.last_plant_step(
            tick, guided, motion, commands.wheel_torque(self._step_start_ns(last)), last
        )
        commands.wait_until(self._step_start_ns(last + 1))
        return next_tick

    def _step_start_ns(self, step: int) -> int:
        """Beginning of a plant step of this tick [ns]."""
        return nanoseconds(self.ticks * self.scenario.tick_s + step * self.scenario.step_s)


class CommandSource(Protocol):
    """The other side of a run."""

    def publish(self, messages: TopicMessages) -> None:
        """Hears what the simulator says."""
        ...

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate | None:
        """Orbit estimate for a tick [ns]."""
        ...

    def burn_command(self, time_ns: int) -> tuple[BurnDecider, ExternalBurn]:
        """Decision on the burn at a tick [ns]."""
        ...

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Wheel torques (3,) [N m] for a plant step [ns]."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Lets a step end at a time [ns]."""
        ...


class _WarmUpCommands:
    """Answers as an other side might, so that all is compiled before there is one."""

    def __init__(self, decider: BurnDecider) -> None:
        self._decider: BurnDecider = decider
        self._messages: dict[str, Any] = {}

    def publish(self, messages: TopicMessages) -> None:
        self._messages |= {topic.name: make() for topic, make in messages}

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate:
        names = (topics.SERVICER_ESTIMATE.name, topics.RELATIVE_ESTIMATE.name)
        return orbit_estimate_from_odometry(*(self._messages[name] for name in names))

    def burn_command(self, time_ns: int) -> tuple[BurnDecider, ExternalBurn]:
        return self._decider, NO_BURN

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        return np.zeros(3)

    def wait_until(self, time_ns: int) -> None:
        pass
