"""The table of replaced stages: every stage that a mode uses reaches its results, every other one is refused."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.interpreters import partial_eval

import rpojax
from rpojax.analysis.reliability.simulated_failures.failure_margin import Failure
from rpojax.analysis.reliability.simulated_failures.simulated_margins import SimulatedMargins
from rpojax.benchmark import closed_loop_speed, filter_speed
from rpojax.campaign import single_run
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.errors import RpojaxError
from rpojax.flight import stage_use
from rpojax.flight.stage_use import MODES, Mode
from rpojax.flight.stages import Stages
from rpojax.interop.cosimulation import compiled_step_stages
from rpojax.interop.cosimulation.command_input import NO_COMMAND
from rpojax.interop.cosimulation.live_run import simulate_live
from rpojax.interop.cosimulation.live_settings import LiveSettings, parse_external_stages
from rpojax.scenario.dispersed_numbers.standard_normal_space import make_space
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins.plugin import Plugin
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.scenario.team.members import member_params
from rpojax.simulation import initial_state
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.external_inputs import ExternalOrbitEstimate
from rpojax.simulation.noise import run_key
from rpojax.simulation.step import step
from rpojax.simulation.team import initial_team, member_axes, team_step
from rpojax.simulation.tick import Loop

pytestmark = pytest.mark.traces

STAGES = tuple(each.name for each in fields(Stages) if each.name != "own_memory")
"""Those of a tick."""
ALWAYS = {"attitude_update", "orbit_update", "orbit_predict", "formation_law", "wheel_torque"}
MISSION = ALWAYS | {"reference", "mission_manager"}
PAIR = [{"name": "one"}, {"name": "other", "initial": {"relative_position_m": [0.0, 45.0, 0.0]}}]
ORBITS = "cooperative_inspection"


def unused(**_: Any) -> None:
    """A stage that is never called."""


def replacing(*names: str) -> Stages:
    return Stages(**dict.fromkeys(names, unused))


def single(*overrides: str, name: str = "inspection", **tables: Any) -> ScenarioFile:
    return scenario_loader.validate({**scenario_loader.load(name, overrides).model_dump(), **tables})


def phases(until: dict[str, Any] | None = None, **tables: Any) -> ScenarioFile:
    """A mission of two phases."""
    place = {"kind": "hold", "position_m": [0.0, -50.0, 0.0]}
    first = {"name": "first", "reference": place, "until": until or {"time_s": 50.0}}
    return single(**tables, phases=[first, {"name": "second", "reference": place}])


def team(sharing: str, phasing: str = "fixed") -> ScenarioFile:
    return scenario_loader.load(ORBITS, [f"navigation.sharing={sharing}", f"team.phasing={phasing}"])


KINDS: dict[Mode, Callable[[], ScenarioFile]] = {
    stage_use.WITHOUT_PHASES: single,
    stage_use.PHASES: phases,
    stage_use.ARRIVAL: lambda: phases({"arrival_box_m": [1.0, 1.0, 1.0]}),
    stage_use.ALONE: single,
    stage_use.FIXED_PHASES: lambda: team("boxes"),
    stage_use.CHOSEN_PHASES: lambda: team("boxes", "spread"),
    stage_use.SHARING["none"]: lambda: single(servicers=PAIR),
    **{stage_use.SHARING[name]: lambda name=name: team(name) for name in ("boxes", "estimates", "central", "naive")},
    stage_use.CAMERAS["geometric"]: single,
    stage_use.CAMERAS["statistical"]: lambda: single("camera.model=statistical"),
    stage_use.CAMERAS["rendered"]: lambda: single("camera.model=rendered"),
}
"""A scenario of each kind."""


def kinds_of(scenario: Scenario) -> list[Mode]:
    return stage_use.kinds_of(scenario.camera_model, scenario.mission, scenario.team)


def static(file: ScenarioFile) -> Scenario:
    return static_settings(file, allow_team=True)


def reaching(simulate: Callable[..., Any], names: Iterable[str], *arguments: Any) -> set[str]:
    """Those of the stages on which the results of a traced function of `Stages` depend; nothing is compiled.

    A stage gives the packaged one's result, or zeros without its mark; a mark counts as used if the results need it.
    """
    packaged = Stages()

    def marked(name: str, mark: jax.Array) -> Callable[..., Any]:
        def stage(**inputs: Any) -> Any:
            result = packaged.call(name, **inputs)
            return jax.tree.map(lambda leaf: jnp.where(mark, leaf, jnp.zeros_like(leaf)), result)

        return stage

    def traced(marks: dict[str, jax.Array], arguments: Any) -> Any:
        return simulate(Stages(**{name: marked(name, mark) for name, mark in marks.items()}), *arguments)

    marks = {name: jax.ShapeDtypeStruct((), np.bool_) for name in sorted(names)}
    jaxpr = jax.make_jaxpr(traced)(marks, arguments).jaxpr
    _, used = partial_eval.dce_jaxpr(jaxpr, [True] * len(jaxpr.outvars))
    return {name for name, is_used in zip(sorted(names), used, strict=False) if is_used}


def ticks_of_one(file: ScenarioFile, names: Iterable[str]) -> set[str]:
    """Stages on which the channels of two ticks and the state of the vehicle after them depend."""
    scenario, params = single_run.nominal_parameters(file)
    state = jax.eval_shape(lambda: initial_state.init(scenario, params, run_key(0, 0)))

    def simulate(stages: Stages, state: Any) -> Any:
        def tick(now: Any, _: None) -> Any:
            after, seen = step(scenario, params, now, stages)
            return after, (compute_channels(scenario, params, seen), after.truth)

        return jax.lax.scan(tick, state, None, length=2)[1]

    return reaching(simulate, names, state)


def ticks_of_team(file: ScenarioFile, names: Iterable[str]) -> set[str]:
    """The same of a team."""
    scenario, params = static(file), member_axes.stack_members(member_params(file))
    state = jax.eval_shape(lambda: initial_team.init(scenario, params, run_key(0, 0)))

    def simulate(stages: Stages, state: Any) -> Any:
        def tick(now: Any, _: None) -> Any:
            after, seen = team_step.step(scenario, params, now, stages)
            return after, (seen.truth, seen.flight.orbit.relative, after.servicers.truth)

        return jax.lax.scan(tick, state, None, length=2)[1]

    return reaching(simulate, names, state)


def refused_by(modes: Iterable[Mode]) -> set[str]:
    return {stage for mode in modes for stage in mode.refused}


def test_the_table_names_every_mode_and_only_stages() -> None:
    assert len({mode.name for mode in MODES}) == len(MODES)
    assert refused_by(MODES) <= {*STAGES, "own_memory"}
    assert {*KINDS, *USES} == {*MODES}
    for mode, make in KINDS.items():
        assert mode in kinds_of(static(make()))


@pytest.mark.parametrize(
    ("file", "used"),
    [
        (single, ALWAYS),
        (phases, MISSION),
        pytest.param(KINDS[stage_use.ARRIVAL], MISSION - {"reference"}, marks=pytest.mark.slow),
        pytest.param(KINDS[stage_use.CAMERAS["statistical"]], ALWAYS, marks=pytest.mark.slow),
        pytest.param(KINDS[stage_use.CAMERAS["rendered"]], ALWAYS | {"detector_window"}, marks=pytest.mark.slow),
    ],
)
def test_what_a_scenario_of_one_servicer_uses_reaches_its_results(
    file: Callable[[], ScenarioFile], used: set[str]
) -> None:
    made = file()
    assert set(STAGES) - refused_by(kinds_of(static(made))) == used
    assert ticks_of_one(made, used) == used


@pytest.mark.slow
def test_what_is_refused_for_a_scenario_without_phases_would_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage_use, "check", lambda *_: None)
    assert ticks_of_one(single(), STAGES) == ALWAYS


@pytest.mark.parametrize(
    ("file", "used"),
    [
        (KINDS[stage_use.SHARING["none"]], ALWAYS),
        *(
            pytest.param(make, used, marks=pytest.mark.slow)
            for make, used in (
                (KINDS[stage_use.SHARING["naive"]], MISSION),
                (KINDS[stage_use.SHARING["boxes"]], MISSION - {"orbit_update", "orbit_predict"}),
                (KINDS[stage_use.SHARING["central"]], MISSION - {"orbit_update", "orbit_predict"}),
                (KINDS[stage_use.SHARING["estimates"]], MISSION - {"orbit_update", "orbit_predict"}),
                (
                    KINDS[stage_use.CHOSEN_PHASES],
                    MISSION - {"orbit_update", "orbit_predict", "reference"} | {"team_phasing"},
                ),
            )
        ),
    ],
)
def test_what_a_team_uses_reaches_its_results(file: Callable[[], ScenarioFile], used: set[str]) -> None:
    made = file()
    assert set(STAGES) - refused_by(kinds_of(static(made))) == used
    assert ticks_of_team(made, used) == used


@pytest.mark.parametrize("mode", KINDS, ids=lambda mode: mode.name)
def test_a_stage_that_a_kind_of_scenario_does_not_use_is_refused_when_its_loop_is_made(mode: Mode) -> None:
    scenario = static(KINDS[mode]())
    for stage, reason in mode.refused.items():
        with pytest.raises(RpojaxError) as caught:
            Loop(scenario, None, replacing(stage))  # type: ignore[arg-type]
        message = str(caught.value)
        assert message.startswith(f"stages.{stage}: found one of your own, expected the packaged one in ")
        assert "\n" not in message
        stage_use.check(replacing(*set(STAGES) - set(mode.refused)), [mode])
        with pytest.raises(RpojaxError, match=reason.replace("`", ".")):
            stage_use.check(replacing(stage), [mode])


class CalledError(Exception):
    """Raised by a stage when it is traced."""


def called(**_: Any) -> None:
    """A stage that says that it is called."""
    raise CalledError


def with_stage(stage: str) -> ScenarioFile:
    """A scenario whose plugin has a stage that says that it is called."""
    plugin = Plugin(stages=Stages(**{stage: called}))
    return scenario_loader.load("inspection", ["duration_s=400"], plugin=plugin)


def probability(file: ScenarioFile) -> None:
    SimulatedMargins(make_space(file), Failure("min_range_m", "at least", 5.0), 0, 1).compile()


def replay(file: ScenarioFile) -> None:
    from rpojax.interop import run_replay, spacecraft_states
    from rpojax.scenario.plugins import plugin_registry

    scenario, params = single_run.nominal_parameters(file)
    state = jax.eval_shape(lambda: initial_state.init(scenario, params, run_key(0, 0)))
    stages = plugin_registry.stages_of(file)
    observe = spacecraft_states.observe_tick
    jax.eval_shape(lambda now: run_replay._simulate_segment(scenario, stages, observe, params, now, 1), state)


METRIC = "delta_v_m_s"
USES: dict[Mode, Sequence[Callable[[ScenarioFile], Any]]] = {
    stage_use.RUNS: (
        lambda file: BatchEngine(file, 1, jax.devices()[:1]).channel_names(),
        lambda file: rpojax.simulate(file, progress=False),
    ),
    stage_use.REPLAYS: (replay,),
    stage_use.DERIVATIVES: (
        lambda file: rpojax.gradient(file, ["servicer.mass_kg"], metrics=[METRIC], runs=1, progress=False),
        lambda file: rpojax.sensitivity(file, [METRIC], runs=8, progress=False),
        lambda file: rpojax.worst_case(file, metric=METRIC, limit=1.0, starts=1, progress=False),
        lambda file: rpojax.tune(file, ["navigation.gps_noise_m"], runs=2, steps=1, progress=False),
    ),
    stage_use.RARE_EVENTS: (probability,),
    stage_use.LINEAR_COVARIANCE: (lambda file: rpojax.linear_covariance(file, progress=False),),
    stage_use.BENCH_LOOP: (lambda file: closed_loop_speed.build_engine(file, 1).channel_names(),),
    stage_use.BENCH_KERNELS: (),
    stage_use.LIVE: (),
    **dict.fromkeys(stage_use.EXTERNAL.values(), ()),
}
"""Entry points of each use of the closed loop; live runs have tests of their own, and kernels call no stage."""


ENTRIES = [
    pytest.param(each, id=f"{mode.name} {number}")
    for mode, entries in USES.items()
    for number, each in enumerate(entries)
]


@pytest.mark.parametrize("enter", ENTRIES)
def test_every_use_of_the_loop_has_the_stages_of_the_scenario(enter: Callable[[ScenarioFile], Any]) -> None:
    """The first stage of a tick; the tick is that of the tests above."""
    with pytest.raises(CalledError):
        enter(with_stage("attitude_update"))


@pytest.mark.parametrize("enter", ENTRIES)
def test_every_use_of_the_loop_refuses_a_stage_of_phases_without_phases(enter: Callable[[ScenarioFile], Any]) -> None:
    with pytest.raises(RpojaxError, match=r"^stages.reference: found one of your own, expected [^\n]*without phases"):
        enter(with_stage("reference"))


def test_the_kernels_of_the_benchmark_refuse_a_replaced_orbit_filter() -> None:
    for stage in ("orbit_update", "orbit_predict"):
        with pytest.raises(RpojaxError, match=f"stages.{stage}: found one of your own, expected [^\n]*kernels"):
            filter_speed.measure(with_stage(stage))
    filter_speed.check_filter(with_stage("formation_law"))


@pytest.mark.parametrize("part", stage_use.EXTERNAL)
def test_a_live_run_refuses_stages_that_are_left_to_another_program(part: str) -> None:
    settings = LiveSettings(external_stages=parse_external_stages(part))
    for stage in stage_use.EXTERNAL[part].refused:
        with pytest.raises(
            RpojaxError, match=f"^stages.{stage}: found one of your own, expected [^\n]*external {part}"
        ):
            simulate_live(with_stage(stage), 0, 0, settings, lambda _: None)


def live_tick(file: ScenarioFile, external: set[str]) -> set[str]:
    """Stages that reach the messages of a live tick, and the state at its end."""
    scenario, params = single_run.nominal_parameters(file)
    state = jax.eval_shape(lambda: initial_state.init(scenario, params, run_key(0, 0)))
    vectors = dict.fromkeys(("r_SN_N", "v_SN_N", "r_TS_N", "v_TS_N"), jnp.ones(3))
    covariances = dict.fromkeys(("servicer_covariance", "relative_covariance"), jnp.eye(6))
    estimate = ExternalOrbitEstimate(**vectors, **covariances)
    torque = (jnp.zeros(3), jnp.int32(0))

    def simulate(stages: Stages, state: Any) -> Any:
        tick, first, _ = compiled_step_stages._begin_tick(scenario, stages, params, state)
        if "navigation" in external:
            (tick,) = compiled_step_stages._replace_orbit(tick, estimate)
        takes_burns = "formation" in external
        guided, motion, values = compiled_step_stages._plan_and_guide(
            scenario, stages, takes_burns, params, tick, NO_COMMAND
        )
        if "attitude" in external:
            return (
                first,
                values,
                compiled_step_stages._last_plant_step(scenario, stages, params, guided, motion, torque),
            )
        return first, values, compiled_step_stages._all_plant_steps(scenario, stages, params, guided)

    refused = refused_by([*kinds_of(scenario), *(stage_use.EXTERNAL[each] for each in external)])
    return reaching(simulate, set(STAGES) - refused, state)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("external", "used"),
    [
        (set(), MISSION),
        ({"attitude"}, MISSION - {"wheel_torque"}),
        ({"formation"}, MISSION - {"formation_law", "reference"}),
        ({"navigation"}, MISSION - {"orbit_update"}),
    ],
)
def test_what_a_live_run_uses_reaches_its_messages(external: set[str], used: set[str]) -> None:
    assert live_tick(phases(), external) == used
