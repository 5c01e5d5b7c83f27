"""Options of the commands that simulate runs, of those about campaigns under way, and of the benchmark."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.campaign.options.campaign_options import CampaignOptions, Shard
from rpojax.cli.options.arguments import (
    FLAT,
    AllowPlugin,
    AsJson,
    Command,
    Folder,
    Force,
    NoCache,
    NoFilm,
    Out,
    Overrides,
    Seed,
    Session,
    Source,
)
from rpojax.cli.output_paths import claim
from rpojax.errors import RpojaxError

BENCH_DURATION_S = 800.0
"""Simulated time of a run of the benchmark where a scenario accepts it [s]."""
PARTS = {
    "loop": "the closed loop",
    "kernels": "bare orbits and the orbit filter",
    "vision": "pictures of the packaged target and the detector",
}
"""Part of the benchmark -> what it measures."""


@dataclass(frozen=True)
class CampaignOutput:
    """What a campaign writes beside its results, and what it may replace."""

    force: Force = False
    no_report: Annotated[bool, arg(help="Write no report.html, report.json and figures.")] = False
    no_film: NoFilm = False


@dataclass(frozen=True)
class DryRunOptions:
    """Whether nothing is simulated, and what is shown then."""

    dry_run: Annotated[
        bool, arg(help="Simulate nothing: show what the runs would draw, and the resources they would take.")
    ] = False
    plan: Annotated[Path | None, arg(metavar="FILE", help="CSV file to write in a dry run, one row per run.")] = None
    speed: Annotated[
        float | None,
        arg(metavar="X", help="Run-seconds per second for the estimate of a dry run, as measured by `rpojax bench`."),
    ] = None

    def check(self, out: Path | None, force: bool) -> None:
        """Raises on options that contradict each other, before any work.

        Raises:
            RpojaxError: naming the option.
        """
        if not self.dry_run:
            for option, value in (("plan", self.plan), ("speed", self.speed)):
                if value is not None:
                    raise RpojaxError.of_argument(option, f"found {str(value)!r}, expected it with --dry-run only")
            if out is None:
                raise RpojaxError.of_argument("out", "missing, expected a folder to make (or --dry-run)")
        if self.plan is not None:
            claim(self.plan, force, (".csv",))


@dataclass(frozen=True)
class ExecutorOptions:
    """Which processes simulate the blocks of a campaign."""

    shard: Annotated[
        str | None,
        arg(metavar="I/N", help="Only the blocks b with b % N == I - 1, into a folder shared with the other shards."),
    ] = None
    workers: Annotated[
        int | None, arg(metavar="N", help="Number of worker processes; the crash of one does not affect the others.")
    ] = None
    executor: Annotated[str, arg(metavar="KIND", help="Executor of the blocks: 'local', or 'dask' for a cluster.")] = (
        "local"
    )
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help="Address of the running Dask scheduler.")] = None

    def check(self, force: bool = False) -> None:
        """Raises on options that contradict each other, before any work.

        Raises:
            RpojaxError: naming the option.
        """
        if self.executor not in ("local", "dask"):
            raise RpojaxError.of_argument("executor", f"found {self.executor!r}, expected 'local' or 'dask'")
        if (self.executor == "dask") != (self.scheduler is not None):
            found = f"--executor {self.executor} and {'no' if self.scheduler is None else 'a'} --scheduler"
            raise RpojaxError.of_argument(
                "scheduler", f"found {found}, expected it with --executor dask and only there"
            )
        if self.workers is not None and (self.workers < 1 or self.executor == "dask"):
            raise RpojaxError.of_argument("workers", f"found {self.workers}, expected at least 1, and --executor local")
        if self.shard is not None and force:
            raise RpojaxError.of_argument(
                "force", "found it with --shard, expected it without: a shard joins the folder of the others"
            )

    def refuse_other_processes(self) -> None:
        """Raises on any option, where work goes on in this process alone.

        Raises:
            RpojaxError: naming the option.
        """
        for name in ("shard", "workers", "scheduler"):
            if getattr(self, name) is not None:
                raise RpojaxError.of_argument(
                    name, "found it with an estimate of a probability, expected it with a campaign"
                )

    def parse_shard(self) -> Shard | None:
        """The shard, None for all blocks.

        Raises:
            RpojaxError: the text has another form, or there is no such shard.
        """
        return None if self.shard is None else Shard.parse(self.shard)


@dataclass(frozen=True, kw_only=True)
class RunCommand(Command):
    """One run with its full history: a campaign of one run, with its report."""

    work = "campaigns.run_and_campaign:run"

    scenario: Source
    out: Out
    seed: Seed = 0
    run_id: Annotated[int, arg(metavar="I", help="Number of the run in its campaign.")] = 0
    overrides: Overrides = ()
    block_size: Annotated[int, arg(metavar="N", help="Block size of its campaign, for bit-equal numbers.")] = 1
    force: Force = False
    no_film: NoFilm = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class CampaignCommand(Command):
    """Monte Carlo campaign: many dispersed runs, with a report."""

    work = "campaigns.run_and_campaign:campaign"

    scenario: Source
    options: Annotated[CampaignOptions, FLAT]
    executor: Annotated[ExecutorOptions, FLAT]
    output: Annotated[CampaignOutput, FLAT]
    dry_run: Annotated[DryRunOptions, FLAT]
    session: Annotated[Session, FLAT]
    out: Annotated[
        Path | None, arg(metavar="DIR", help="Folder to create for the results.", help_behavior_hint="(required)")
    ] = None
    overrides: Overrides = ()


@dataclass(frozen=True, kw_only=True)
class ResumeCommand(Command):
    """Complete an interrupted campaign and its report, or an estimate; one that is complete is left as it is."""

    work = "campaigns.run_and_campaign:resume"

    directory: Annotated[Positional[Path], arg(metavar="DIR", help="Folder of a campaign, or of an estimate.")]
    executor: Annotated[ExecutorOptions, FLAT]
    session: Annotated[Session, FLAT]


@dataclass(frozen=True, kw_only=True)
class StatusCommand(Command):
    """Progress of a campaign: blocks, runs, failures and speed so far; also while it is running."""

    work = "campaigns.status:status"
    prepares_jax = False

    directory: Folder
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class RerunCommand(Command):
    """Repeat one run of a campaign with its full history, and compare it with the record."""

    work = "campaigns.run_and_campaign:rerun"

    directory: Folder
    run_id: Annotated[int, arg(metavar="I", help="Number of the run.")]
    out: Out
    force: Force = False
    no_film: NoFilm = False
    as_json: AsJson = False
    no_cache: NoCache = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class ProbabilityCommand(Command):
    """How likely a run is to break a requirement or a limit, or to end with an outcome; the same command resumes it."""

    work = "campaigns.probability:probability"

    scenario: Source
    choice: Annotated[FailureChoice, FLAT]
    settings: Annotated[EstimateSettings, FLAT]
    session: Annotated[Session, FLAT]
    out: Out
    seed: Seed = 0
    overrides: Overrides = ()
    force: Annotated[bool, arg(help="Replace another estimate in the folder.")] = False


@dataclass(frozen=True, kw_only=True)
class BenchCommand(Command):
    """Measure the speed of the closed loop (without metrics and storage), its kernels and rendered pictures.

    Programs are compiled anew.
    """

    work = "campaigns.bench:bench"
    keeps_programs = False

    scenario: Source = "inspection"
    overrides: Overrides = ()
    runs: Annotated[
        tuple[int, ...],
        arg(
            metavar="N",
            help="Batch sizes of the closed loop.",
            help_behavior_hint="(default: 1, 64, 512, 2048 and what a campaign takes at once)",
        ),
    ] = ()
    duration_s: Annotated[
        float | None,
        arg(
            metavar="T",
            help="Simulated time of a run [s].",
            help_behavior_hint=f"(default: {BENCH_DURATION_S:g}, doubled as often as the scenario's phases need)",
        ),
    ] = None
    only: Annotated[str, arg(metavar="PARTS", help="Parts to measure.")] = ",".join(PARTS)
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False
