"""Options of a campaign: one record for the command line, for Python and for `campaign.json`. Free of jax and numpy."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypedDict

from tyro.conf import AvoidSubcommands, Fixed, arg

from rpojax.campaign import argument_checks
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.options.sequential_plan import SequentialPlan
from rpojax.dispersions.designs.run_range import RunRange, recorded_run_range
from rpojax.errors import RpojaxError

DEFAULT_HISTORIES = Retention("8+requirements")
"""The first eight runs keep a full history, and the worst run of each requirement."""


UNSTATED: Final = -(2**63)
"""Number of runs of a command that states none; nobody asks for it."""


@dataclass(frozen=True)
class CampaignOptions:
    """Runs of a scenario that a campaign simulates, and the histories that it keeps.

    The command `rpojax campaign` has the fields as options, except those marked `Fixed`.

    Attributes:
        runs: number of runs
        seed: master seed
        first_run: number of the first run
        block_size: runs per block and device; None for that of the kind of device
        histories: which runs keep a history
        run_range: the runs that the experiment design is made for, if they are more than these
        report: whether a report is wanted, so that a resume writes it
        until_decided: whether the campaign ends as soon as its requirements are verified or refuted
        plan: its looks, if so

    Raises:
        RpojaxError: a number is out of range, or a history is wanted of a run outside of the campaign.
    """

    runs: Annotated[
        int,
        arg(
            metavar="N",
            aliases=("--at-most",),
            help="Number of runs; with --until-decided the most.",
            help_behavior_hint="(required; with --until-decided by default what its hardest requirement may take)",
        ),
    ] = UNSTATED
    seed: Annotated[int, arg(metavar="S", help="Master seed.")] = 0
    first_run: Fixed[int] = 0
    block_size: Annotated[
        int | None,
        arg(
            metavar="N",
            help="Runs at once on a device.",
            help_behavior_hint="(default: 128 on a CPU, 4096 elsewhere)",
        ),
    ] = None
    histories: Annotated[Retention, arg(name="")] = DEFAULT_HISTORIES
    run_range: Annotated[RunRange | None, Fixed, AvoidSubcommands] = None
    report: Fixed[bool] = False
    until_decided: Annotated[
        bool, arg(help="End as soon as every requirement is verified or refuted; the risks include all looks.")
    ] = False
    plan: Annotated[SequentialPlan | None, Fixed, AvoidSubcommands] = None

    def __post_init__(self) -> None:
        if self.runs == UNSTATED:
            if self.until_decided:
                return  # the record is made again with a number, and checked
            raise RpojaxError.of_argument("runs", "missing, expected the number of runs (or --until-decided)")
        argument_checks.check_numbers(self.runs, self.first_run, self.seed, self.block_size)
        self.histories.check_run_ids(self.first_run, self.runs)

    @property
    def design_range(self) -> RunRange:
        """The runs that the experiment design is made for."""
        return self.run_range or RunRange(self.first_run, self.runs)

    def max_full_histories(self, requirements: int) -> int:
        """Largest number of histories without those of failures, in full histories of the same total size.

        `requirements` is the number of those of the scenario.
        """
        return -(-self.histories.max_histories(self.first_run, self.runs, requirements) // self.histories.every)

    def to_record(self) -> dict[str, Any]:
        """Entries of `campaign.json`."""
        design = self.design_range
        return {
            "seed": self.seed,
            "runs": self.runs,
            "first_run": self.first_run,
            "block_size": self.block_size,
            "histories": self.histories.to_record(),
            "design": {"first_run": design.first_run, "runs": design.runs},
            "report": self.report,
            **({} if self.plan is None else {"sequential": self.plan.to_record()}),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "CampaignOptions":
        """Options from entries of `campaign.json`, the types of which are as `to_record` has them.

        Raises:
            RpojaxError: an entry is out of range.
        """
        runs, first_run = record["runs"], record["first_run"]
        run_range = recorded_run_range(record["design"], first_run, runs)
        return cls(
            runs=runs,
            seed=record["seed"],
            first_run=first_run,
            block_size=record["block_size"],
            histories=Retention.from_record(record["histories"]),
            run_range=None if run_range == RunRange(first_run, runs) else run_range,
            report=record["report"],
            until_decided="sequential" in record,
            plan=SequentialPlan.from_record(record["sequential"], runs) if "sequential" in record else None,
        )


class FurtherOptions(TypedDict, total=False):
    """Fields of `CampaignOptions` that `run_campaign` takes as further keywords."""

    first_run: int
    block_size: int | None
    run_range: RunRange | None
    report: bool
    until_decided: bool


@dataclass(frozen=True)
class Shard:
    """Shard `number` of `count`, from 1: the blocks b with b % count == number - 1."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Shard from text such as `2/8`.

        Raises:
            RpojaxError: the text has another form, or there is no such shard.
        """
        found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise RpojaxError.of_argument("shard", f"found {text!r}, expected i/n with i from 1 to n, such as 2/8")
        return cls(int(found[1]), int(found[2]))

    def select(self, blocks: Sequence[int]) -> list[int]:
        """The blocks that belong to this shard."""
        return [block for block in blocks if block % self.count == self.number - 1]


ALL_BLOCKS = Shard(1, 1)
"""The only shard of a campaign that is not divided."""
