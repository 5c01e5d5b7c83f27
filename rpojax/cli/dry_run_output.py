"""Output of `rpojax campaign --dry-run`: what would be drawn, and the resources it would take."""

import datetime
from pathlib import Path

from rpojax.campaign import argument_checks
from rpojax.campaign import dry_run as plans
from rpojax.campaign.dry_run import Plan
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.options.campaigns import DryRunOptions
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.progress import stage
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.schema import ScenarioFile


def show(
    file: ScenarioFile,
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
    if out is not None:
        argument_checks.check_folder(out, force)
    with stage("drawing", quiet=as_json):
        plan = plans.plan_campaign(file, options, speed=dry_run.speed)
    if dry_run.plan is not None:
        write_atomically(dry_run.plan, plans.csv_text(plan).encode())
    if as_json:
        print_json(plans.as_json(plan))
    else:
        print("\n".join(_lines(plan, dry_run.plan)))


def _lines(plan: Plan, table: Path | None) -> list[str]:
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
