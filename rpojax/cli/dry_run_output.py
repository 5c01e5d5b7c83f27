"""Output of `rpojax campaign --dry-run`: what would be drawn, and the resources it would take."""

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import stage

if TYPE_CHECKING:
    from rpojax.campaign.dry_run import Plan
    from rpojax.scenario.schema import ScenarioFile


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
                raise RpojaxError.of_argument("out", "found nothing, expected a folder to make (or --dry-run)")
        if self.plan is not None:
            claim(self.plan, force, (".csv",))


def show(
    file: "ScenarioFile",
    options: CampaignOptions,
    dry_run: DryRunOptions,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Prints what a campaign would draw and need, and writes the table of runs if a path is given.

    Raises:
        RpojaxError: the campaign would be refused, or the table cannot be written.
    """
    from rpojax.campaign import dry_run as plans
    from rpojax.campaign import preflight
    from rpojax.campaign.storage.atomic_outputs import write_atomically

    if out is not None:
        preflight.check_folder(out, force)
    with stage("drawing", quiet=as_json):
        plan = plans.plan_campaign(file, options, speed=dry_run.speed)
    if dry_run.plan is not None:
        write_atomically(dry_run.plan, plans.csv_text(plan).encode())
    if as_json:
        print_json(plans.as_json(plan))
    else:
        print("\n".join(_lines(plan, dry_run.plan)))


def _lines(plan: "Plan", table: Path | None) -> list[str]:
    from rpojax.scenario.loading.scenario_warnings import scenario_warnings

    found = plan.estimate
    lines = [
        f"{plan.file.name}: {len(plan.run_ids)} runs of {plan.file.duration_s:g} s, seed {plan.seed}, "
        f"{plan.file.design.kind} draws of {len(plan.values)} keys",
        f"memory: up to {found.memory_bytes / 1e6:,.0f} MB",
        f"disk: up to {found.disk_bytes / 1e6:,.0f} MB",
    ]
    if found.time_s is None:
        lines.append(f"time: unknown, speed {found.speed_source}; give --speed")
    else:
        time = datetime.timedelta(seconds=round(found.time_s))
        speed = f"{found.run_seconds_per_s:,.0f} run-s/s, {found.speed_source}"
        lines.append(f"time: about {time} beside compilation and report ({speed})")
    lines += [f"warning: {warning}" for warning in scenario_warnings(plan.file)]
    return lines + ([] if table is None else [f"plan: {table}"])
