"""Options of the commands that find gains, uncertainties and worst cases, or compare campaigns."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.analysis.reliability.search_settings import LimitChoice, SearchSettings
from rpojax.cli.options.arguments import (
    FLAT,
    AllowPlugin,
    AsJson,
    Command,
    NoCache,
    Out,
    Overrides,
    Seed,
    Session,
    Source,
)


@dataclass(frozen=True, kw_only=True)
class CompareCommand(Command):
    """What changed from one campaign to others, run by run: run n had the same dispersions in all of them.

    With --json also the metrics of each servicer of a team.
    """

    work = "analysis.compare:compare"

    first: Annotated[Positional[Path], arg(metavar="DIR_A", help="Folder of a campaign.")]
    second: Annotated[Positional[Path], arg(metavar="DIR_B", help="Folder of another one with the same seed.")]
    more: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR...", help="Further ones.")] = ()
    out: Annotated[Path | None, arg(metavar="FILE", help="Page to write, such as compare.html.")] = None
    force: Annotated[bool, arg(help="Replace the page if it is there.")] = False
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class LincovCommand(Command):
    """Mean, spread and error budget of a scenario's runs by linear covariance, without sampling."""

    work = "analysis.lincov:lincov"
    has_small_matrices = True

    scenario: Source
    out: Out
    overrides: Overrides = ()
    runs: Annotated[int, arg(metavar="N", help="Runs to simulate for comparison; 0 for none.")] = 0
    seed: Seed = 0
    members: Annotated[int, arg(metavar="N", help="Tumbling targets in the ensemble of outlines.")] = 256
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class SensitivityCommand(Command):
    """Which dispersions make the spread of a metric, from derivatives of a handful of runs."""

    work = "analysis.sensitivity:sensitivity"

    scenario: Source
    metric: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="NAME",
            help="Metric; the option may be given several times.",
            help_behavior_hint="(default: those of the scenario's requirements)",
        ),
    ] = ()
    runs: Annotated[int, arg(metavar="N", help="Runs with random dispersions, beside the median one.")] = 16
    campaign: Annotated[
        Path | None, arg(metavar="DIR", help="Finished campaign whose ranking by sampling is put beside.")
    ] = None
    seed: Seed = 0
    overrides: Overrides = ()
    out: Annotated[
        Path | None, arg(metavar="FILE", help="JSON file to write.", help_behavior_hint="(default: none)")
    ] = None
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class TuneCommand(Command):
    """Tune gains and filter noises by gradient, and compare the result with the start on runs never used in tuning."""

    work = "analysis.tune:tune"

    scenario: Source
    settings: Annotated[TuningSettings, FLAT]
    session: Annotated[Session, FLAT]
    out: Annotated[Path, arg(metavar="FILE", help="Scenario file to write (.toml); a .json beside it holds all steps.")]
    parameters: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="NAMES",
            help="What to tune: navigation, pose, gate, formation, attitude, schedule, or keys.",
            help_behavior_hint="(default: navigation)",
        ),
    ] = ()
    overrides: Overrides = ()
    resume: Annotated[bool, arg(help="Go on with an interrupted tuning.")] = False
    force: Annotated[bool, arg(help="Replace what is there.")] = False


@dataclass(frozen=True, kw_only=True)
class WorstCaseCommand(Command):
    """The most likely combination of dispersions that breaks a requirement, as a scenario to simulate."""

    work = "analysis.worst_case:worst_case"

    scenario: Source
    choice: Annotated[LimitChoice, FLAT]
    settings: Annotated[SearchSettings, FLAT]
    session: Annotated[Session, FLAT]
    out: Out
    seed: Seed = 0
    overrides: Overrides = ()
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False


@dataclass(frozen=True, kw_only=True)
class RobustnessCommand(Command):
    """How far each quantity that the filter believes may be off before a requirement breaks, as a page.

    Each is moved alone, by steps of the same runs.
    """

    work = "analysis.robustness:robustness"

    scenario: Source
    session: Annotated[Session, FLAT]
    out: Out
    runs: Annotated[int, arg(metavar="N", help="Runs of each step; there are some seventy steps.")] = 100
    seed: Seed = 0
    overrides: Overrides = ()
    free_drifts: Annotated[bool, arg(help="Judge requirements on free drifts and coverage, too, which is slower.")] = (
        False
    )
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False


@dataclass(frozen=True, kw_only=True)
class FaultsCommand(Command):
    """Which faults of the equipment a scenario's runs survive, by kind and time, with share and margin, as a page.

    Every kind of fault of every wheel, thruster and sensor is injected at every time into the same runs.
    """

    work = "analysis.faults:faults"

    scenario: Source
    session: Annotated[Session, FLAT]
    out: Out
    runs: Annotated[int, arg(metavar="N", help="Runs of each fault and time.")] = 32
    times: Annotated[
        str, arg(metavar="T1,T2,...", help="When faults begin [s].", help_behavior_hint="(default: see --every)")
    ] = ""
    every: Annotated[
        float | None,
        arg(metavar="S", help="Time between them [s].", help_behavior_hint="(default: a quarter of the run)"),
    ] = None
    double: Annotated[bool, arg(help="Inject each two faults of different equipment at once.")] = False
    seed: Seed = 0
    overrides: Overrides = ()
    free_drifts: Annotated[bool, arg(help="Judge requirements on free drifts and coverage, too, which is slower.")] = (
        False
    )
    force: Annotated[bool, arg(help="Replace the files if they are there.")] = False
