"""Live run: publishes its measurements and estimates, and takes commands of chosen stages from external nodes."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from rpojax.campaign import single_run
from rpojax.core.array_packing import PackedRecord
from rpojax.errors import ScenarioError, UnfinishedError
from rpojax.flight import stage_use
from rpojax.flight.stages import Stages
from rpojax.interop.cosimulation.clock import LockstepClock, RealTimeClock
from rpojax.interop.cosimulation.command_checks import CommandLimits
from rpojax.interop.cosimulation.command_input import NO_COMMAND, CommandInput, CommandSource, WarmUpCommands
from rpojax.interop.cosimulation.command_subscription import MessageExchange
from rpojax.interop.cosimulation.compiled_step_stages import CompiledStages, PackedTick
from rpojax.interop.cosimulation.event_log import EventLog, LineWriter
from rpojax.interop.cosimulation.live_publisher import LiveMessages
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings
from rpojax.interop.cosimulation.live_topics import command_topics, published_topics
from rpojax.interop.ros2.message_builders import nanoseconds
from rpojax.runtime import garbage_collection
from rpojax.runtime.progress import items, stage
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.measurement_delays import delay_settings
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import refuse_team
from rpojax.simulation.channels import Channels
from rpojax.simulation.metrics import recorded_metrics
from rpojax.simulation.outcomes.judgement import judge_one
from rpojax.simulation.outcomes.outcome_kinds import Outcome


@dataclass(frozen=True)
class LiveRunResult:
    """Result of a live run.

    Attributes:
        ticks: number of simulated ticks
        steps: number of plant steps
        outcome: how the run ended, None if it was stopped before its end
        failure: reason of a failed run, else ""
        stop_reason: reason why the run was stopped before its end, else ""
        metrics: of a run that reached its end, else empty
        events: ignored, late and limited commands
        sent: messages by topic
        received: messages by topic
        unsent: messages that a subscriber was too slow for
        simulated_s: simulated time
        wall_s: elapsed real time
        cpu_s: processor time of this process
        lag_s: largest delay of a real-time run behind the wall clock
    """

    ticks: int
    steps: int
    outcome: Outcome | None
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
    """Simulates one run live; progress is shown on stderr, and `write_line` gets lines on events.

    Raises:
        RpojaxError: the scenario is that of a team, its plugin is not allowed, a stage is replaced that is left to
            external nodes, the domain cannot be joined, or no external nodes were found.
    """
    refuse_team(file, "a live run")
    if file.thrusters:
        raise ScenarioError("thrusters", len(file.thrusters), "a scenario without [[thrusters]] for a live run")
    if delay_settings(file) is not None:
        # Its messages are those of the tick, and their stamps too.
        raise ScenarioError("navigation.delays", file.navigation.delays, "no late measurements in a live run")
    events = EventLog(write_line)
    stages = settings.external_stages
    own = plugin_registry.stages_of(file)
    stage_use.check(own, (stage_use.EXTERNAL[name] for name in sorted(stages)))
    exchange = MessageExchange(settings.domain_id, published_topics(stages), command_topics(stages), events)
    with stage("compiling", quiet=False):
        run = _LiveRun(file, own, seed, run_id, settings)
        run.warm_up()
    with stage("waiting for external nodes", quiet=False):
        exchange.wait_for_nodes(settings.wait_s)
    clock: LockstepClock | RealTimeClock = LockstepClock(settings.timeout_s)
    if settings.real_time_factor is not None:
        clock = RealTimeClock(settings.real_time_factor, nanoseconds(run.scenario.step_s), settings.timeout_s)
    commands = CommandInput(settings, run.limits, exchange, clock, events)
    wall, cpu, stop_reason = time.perf_counter(), time.process_time(), ""
    try:
        with garbage_collection.existing_objects_spared(), items("running", quiet=False, announce=True) as watch:
            while run.is_running:
                exchange.count_type_mismatches()
                run.tick(commands)
                watch(run.ticks, run.scenario.ticks)
    except UnfinishedError as error:
        stop_reason = str(error)
    return LiveRunResult(
        ticks=run.ticks,
        steps=run.ticks * run.scenario.substeps,
        outcome=run.outcome,
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
    """State and records of the run."""

    def __init__(self, file: ScenarioFile, stages: Stages, seed: int, run_id: int, settings: LiveSettings) -> None:
        self._file, self._external_stages = file, settings.external_stages
        self.scenario, self._params, start = single_run.initialise_run(file, seed, run_id, stages=stages)
        own = dispersed_values.read_back(self._params, dispersion_keys.varied_keys(file))
        self._varied = {key: np.asarray(value)[None] for key, value in own.items()}
        self._takes_burns = ExternalStage.FORMATION in settings.external_stages
        self._stages = CompiledStages(self.scenario, stages, self._params, self._takes_burns)
        self._tick = self._stages.first_tick(start)
        self._messages = LiveMessages(settings, nanoseconds(self.scenario.step_s))
        self._sends_images = settings.send_images and self.scenario.camera_model == "rendered"
        self._records: dict[str, np.ndarray] = {}
        self.ticks = 0
        self.outcome: Outcome | None = None

    @property
    def limits(self) -> CommandLimits:
        """Command limits, from the vehicle model of the flight software."""
        vehicle, pointing = self._params.flight.vehicle, self._params.flight.pointing
        return CommandLimits(
            torque=np.asarray(vehicle.wheel_torque_limit),
            minimum_on_time_s=float(vehicle.minimum_on_time),
            maximum_on_time_s=float(pointing.look_away_limit),
        )

    @property
    def failure(self) -> str:
        """Reason of a failed run, else empty."""
        return "" if self.outcome is None else self.outcome.reason

    @property
    def reached_end(self) -> bool:
        """Whether the run was simulated to its end, in whatever state."""
        return self.ticks == self.scenario.ticks and not self._tick.failure

    @property
    def is_running(self) -> bool:
        """Whether the run is neither over nor frozen."""
        return self.ticks < self.scenario.ticks and not self._tick.failure

    def warm_up(self) -> None:
        """Simulates a tick to compile all stages; the state stays as it was."""
        self._simulate_tick(WarmUpCommands(), lambda _: None)

    def tick(self, commands: CommandSource) -> None:
        """Simulates one tick."""
        self._tick = self._simulate_tick(commands, self._record)
        self.ticks += 1
        if self._tick.failure:
            self.outcome = list(Outcome)[self._tick.failure]
        elif self.reached_end:
            self.outcome = judge_one(self._file, self._varied, self._records)

    def _record(self, channels: Channels) -> None:
        for name, value in channels.items():
            if name not in self._records:
                self._records[name] = np.zeros((1, self.scenario.ticks, *value.shape), dtype=value.dtype)
            self._records[name][0, self.ticks] = value

    def metrics(self) -> dict[str, float]:
        """Metrics of a run that reached its end; empty for other runs."""
        if not self.reached_end:
            return {}
        inputs = self._file, self._records, self._varied
        found = recorded_metrics.evaluate(*inputs) | recorded_metrics.evaluate_windows(*inputs)
        return {name: float(values[0]) for name, values in found.items()}

    def _simulate_tick(self, commands: CommandSource, record: Callable[[Channels], None]) -> PackedTick:
        """Publishes, takes the commands of and records this tick, and returns the next one."""
        tick, stages, time_ns = self._tick, self._stages, self._step_start_ns(0)
        commands.publish(self._messages.after_navigation(tick.values))
        if self._sends_images:
            commands.publish(self._messages.camera_image(time_ns, partial(stages.camera_image, tick)))
        if (
            ExternalStage.NAVIGATION in self._external_stages
            and (estimate := commands.orbit_estimate(time_ns)) is not None
        ):
            tick = stages.with_orbit_estimate(tick, estimate)
        burn = commands.burn_command(time_ns) if self._takes_burns else NO_COMMAND
        guided, motion, values = stages.plan_and_guide(tick, burn)
        commands.publish(self._messages.attitude_reference(values, tick.values))

        def publish_and_record() -> None:
            commands.publish(self._messages.after_guidance(values))
            record(values.channels)

        return self._propagate_tick(commands, guided, motion, publish_and_record)

    def _propagate_tick(
        self,
        commands: CommandSource,
        guided: PackedRecord,
        motion: PackedRecord,
        publish_and_record: Callable[[], None],
    ) -> PackedTick:
        """The next tick, after the plant steps of this one.

        `publish_and_record` is called while external nodes compute their first wheel command.
        """
        last = self.scenario.substeps - 1
        if ExternalStage.ATTITUDE not in self._external_stages:
            publish_and_record()
            next_tick = self._stages.all_plant_steps(guided)
            commands.wait_until(self._step_start_ns(last + 1))
            return next_tick
        for step in range(last):
            motion, attitude = self._stages.plant_step(
                guided, motion, commands.wheel_torque(self._step_start_ns(step)), step
            )
            commands.wait_until(self._step_start_ns(step + 1))
            commands.publish(self._messages.plant_step(self._step_start_ns(step + 1), attitude))
            if step == 0:
                publish_and_record()
        if last == 0:
            publish_and_record()
        next_tick = self._stages.last_plant_step(guided, motion, commands.wheel_torque(self._step_start_ns(last)), last)
        commands.wait_until(self._step_start_ns(last + 1))
        return next_tick

    def _step_start_ns(self, step: int) -> int:
        """Start time of a plant step of this tick [ns]."""
        return nanoseconds(self.ticks * self.scenario.tick_s + step * self.scenario.step_s)
