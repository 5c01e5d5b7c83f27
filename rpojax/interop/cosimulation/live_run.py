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
from rpojax.core.array_packing import Bundle
from rpojax.errors import UnfinishedError
from rpojax.interop.cosimulation.clock import Lockstep, RealTime
from rpojax.interop.cosimulation.command_checks import Limits
from rpojax.interop.cosimulation.command_input import CLOSED, Orders
from rpojax.interop.cosimulation.compiled_stages import Opened, Program
from rpojax.interop.cosimulation.event_log import Ledger, Tell
from rpojax.interop.cosimulation.live_settings import Settings, Stage
from rpojax.interop.cosimulation.message_exchange import Exchange
from rpojax.interop.cosimulation.odometry_input import given_orbit
from rpojax.interop.cosimulation.publisher import Words
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import Said, nanoseconds
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop, metrics
from rpojax.simulation.closed_loop import FAILURES
from rpojax.simulation.external_stages import Decider, GivenBurn, GivenOrbit
from rpojax.simulation.telemetry import Channels


@dataclass(frozen=True)
class Outcome:
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
    stopped: str
    metrics: Mapping[str, float]
    ledger: Ledger
    sent: Mapping[str, int]
    received: Mapping[str, int]
    unsent: int
    simulated_s: float
    wall_s: float
    cpu_s: float
    lag_s: float


def fly(file: ScenarioFile, seed: int, run_id: int, settings: Settings, tell: Tell) -> Outcome:
    """Flies one run live; `tell` gets lines on what happens.

    Raises:
        RpojaxError: the domain cannot be joined, or nobody came.
    """
    ledger = Ledger(tell)
    exchange = Exchange(settings.domain_id, settings.said, settings.heard, ledger)
    tell("compiling")
    flight = _Flight(file, seed, run_id, settings)
    flight.rehearse()
    tell("waiting for the other side")
    exchange.meet(settings.wait_s)
    tell("flying")
    # What is here by now stays to the end: there is no use in going through it for garbage again and again.
    gc.collect()
    gc.freeze()
    pace: Lockstep | RealTime = Lockstep(settings.timeout_s)
    if settings.factor is not None:
        pace = RealTime(settings.factor, nanoseconds(flight.scenario.step_s), settings.timeout_s)
    orders = Orders(settings, flight.limits, exchange, pace, ledger)
    wall, cpu, stopped = time.perf_counter(), time.process_time(), ""
    try:
        while flight.goes_on:
            exchange.notice_strangers()
            flight.tick(orders)
    except UnfinishedError as error:
        stopped = str(error)
    finally:
        gc.unfreeze()
    return Outcome(
        ticks=flight.ticks,
        steps=flight.ticks * flight.scenario.substeps,
        completed=flight.completed,
        failure=flight.failure,
        stopped=stopped,
        metrics=flight.metrics(),
        ledger=ledger,
        sent=exchange.sent,
        received=exchange.received,
        unsent=exchange.unsent,
        simulated_s=flight.ticks * flight.scenario.tick_s,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        lag_s=pace.lag_s if isinstance(pace, RealTime) else 0.0,
    )


class _Flight:
    """The run, where it is, and what is recorded of it."""

    def __init__(self, file: ScenarioFile, seed: int, run_id: int, settings: Settings) -> None:
        self._file, self._external = file, settings.external
        self.scenario, self._params, key = single_run.drawn(file, seed, run_id)
        self._program = Program(self.scenario, self._params)
        start = jax.jit(closed_loop.init, static_argnums=0)(self.scenario, self._params, key)
        self._tick = self._program.open(start)
        self._words = Words(settings, nanoseconds(self.scenario.step_s))
        self._pictures = settings.pictures and self.scenario.camera_model == "rendered"
        self._records: dict[str, np.ndarray] = {}
        self.ticks = 0
        self.failure = ""

    @property
    def limits(self) -> Limits:
        """Of commands, by the vehicle's own data base."""
        onboard, pointing = self._params.flight.onboard, self._params.flight.pointing
        return Limits(
            torque=np.asarray(onboard.wheel_torque_limit),
            minimum_on_time_s=float(onboard.minimum_on_time),
            longest_on_time_s=float(pointing.look_away_limit),
        )

    @property
    def completed(self) -> bool:
        """The run was flown to its end."""
        return self.ticks == self.scenario.ticks and not self.failure

    @property
    def goes_on(self) -> bool:
        """The run is neither over nor has it failed."""
        return self.ticks < self.scenario.ticks and not self.failure

    def rehearse(self) -> None:
        """Flies some ticks in every way that may be asked for, so that all is compiled; nothing comes of it."""
        start = self._tick
        deciders: tuple[Decider, ...] = ("given", "nobody") if Stage.FORMATION in self._external else ("own",)
        for decider in deciders:
            self._tick = self._fly(_Rehearsal(decider), lambda _: None)
        self._tick = start

    def tick(self, other: "Other") -> None:
        """Flies one tick."""
        self._tick = self._fly(other, self._record)
        self.failure = FAILURES[self._tick.failure]
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

    def _fly(self, other: "Other", record: Callable[[Channels], None]) -> Opened:
        """The next tick, after this one is recorded: what is said may be answered before the next is done."""
        tick, program, at = self._tick, self._program, self._time(0)
        other.say(self._words.sensed(tick.values))
        if self._pictures:
            other.say(self._words.picture(at, partial(program.picture, tick)))
        if Stage.NAVIGATION in self._external and (given := other.estimate(at)) is not None:
            tick = program.adopt(tick, given)
        decider, burn = other.burn(at) if Stage.FORMATION in self._external else ("own", CLOSED)
        decided, motion, chosen = program.decide(decider, tick, burn)
        other.say(self._words.reference(chosen, tick.values))

        def aside() -> None:
            other.say(self._words.decided(chosen))
            record(chosen.channels)

        return self._move(other, tick, decided, motion, aside)

    def _move(self, other: "Other", tick: Opened, decided: Bundle, motion: Bundle, aside: Callable[[], None]) -> Opened:
        """The next tick, after the plant steps of this one; `aside` is done as soon as the other side has to think."""
        last = self.scenario.substeps - 1
        if Stage.ATTITUDE not in self._external:
            aside()
            following = self._program.close_alone(tick, decided)
            other.hold(self._time(last + 1))
            return following
        for step in range(last):
            motion, attitude = self._program.move(tick, decided, motion, other.torque(self._time(step)), step)
            other.hold(self._time(step + 1))
            other.say(self._words.step(self._time(step + 1), attitude))
            if step == 0:
                aside()
        if last == 0:
            aside()
        following = self._program.close(tick, decided, motion, other.torque(self._time(last)), last)
        other.hold(self._time(last + 1))
        return following

    def _time(self, step: int) -> int:
        """Beginning of a plant step of this tick [ns]."""
        return nanoseconds(self.ticks * self.scenario.tick_s + step * self.scenario.step_s)


class Other(Protocol):
    """The other side of a run."""

    def say(self, said: Said) -> None:
        """Hears what the simulator says."""
        ...

    def estimate(self, at: int) -> GivenOrbit | None:
        """Orbit estimate for a tick [ns]."""
        ...

    def burn(self, at: int) -> tuple[Decider, GivenBurn]:
        """Decision on the burn at a tick [ns]."""
        ...

    def torque(self, at: int) -> np.ndarray:
        """Wheel torques (3,) [N m] for a plant step [ns]."""
        ...

    def hold(self, end: int) -> None:
        """Lets a step end at a time [ns]."""
        ...


class _Rehearsal:
    """Answers as an other side might, so that all is compiled before there is one."""

    def __init__(self, decider: Decider) -> None:
        self._decider: Decider = decider
        self._estimates: dict[str, Any] = {}

    def say(self, said: Said) -> None:
        self._estimates |= {topic.name: make() for topic, make in said}

    def estimate(self, at: int) -> GivenOrbit:
        names = (topics.SERVICER_ESTIMATE.name, topics.RELATIVE_ESTIMATE.name)
        return given_orbit(*(self._estimates[name] for name in names))

    def burn(self, at: int) -> tuple[Decider, GivenBurn]:
        return self._decider, CLOSED

    def torque(self, at: int) -> np.ndarray:
        return np.zeros(3)

    def hold(self, end: int) -> None:
        pass
