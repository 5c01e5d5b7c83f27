"""Looks at a campaign under way, which ends as soon as every requirement is verified or refuted."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rpojax.campaign import experiment_design
from rpojax.campaign.execution.batch_engine import default_block_size
from rpojax.campaign.group_sequential_bounds import Decision, LookPath, fixed_runs, look_bounds
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.sequential_plan import PlannedBounds, SequentialPlan
from rpojax.campaign.storage import look_records
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.look_records import Look, LookVerdict
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

_MOST_LOOKS: Final = 24
_SMALLEST_BLOCK: Final = 8
"""Runs of which blocks take whole numbers, so that a CPU has full vectors."""
_RESERVE: Final = 1.5
"""Runs of a plan with looks over those of a fixed one that misses a good design as seldom."""
_MOST_DEFAULT_RUNS: Final = 100_000


def most_runs(file: ScenarioFile) -> int:
    """Runs at which a campaign ends undecided, if its author does not say: what its hardest requirement may take.

    Raises:
        RpojaxError: there is no requirement, or one takes more runs than should be simulated without asking.
    """
    _check_can_be_decided(file)
    wanted = max(fixed_runs(each.probability, each.consumer_risk) for each in file.requirements)
    runs = round(_RESERVE * wanted)
    if runs > _MOST_DEFAULT_RUNS:
        found = f"missing, expected the number of runs to end at, as the requirements may take {runs:,}"
        raise RpojaxError.of_argument("at_most", found)
    return runs


def with_plan(file: ScenarioFile, options: CampaignOptions, devices: int) -> CampaignOptions:
    """Options with the looks, and blocks of which a look takes whole numbers, for a number of devices.

    Raises:
        RpojaxError: there is no requirement to decide, or the runs are not independent.
    """
    _check_can_be_decided(file)
    between = -(-options.runs // _MOST_LOOKS)
    unit = 1 if file.camera.model == "rendered" else _SMALLEST_BLOCK
    size = options.block_size or min(-(-between // (devices * unit)) * unit, default_block_size(file))
    step = -(-between // size) * size
    looks = (*range(step, options.runs, step), options.runs)
    plan = SequentialPlan(looks)
    bounds = tuple(_planned_bounds(each, plan) for each in file.requirements)
    return replace(options, block_size=size, plan=replace(plan, bounds=bounds))


def _check_can_be_decided(file: ScenarioFile) -> None:
    if not file.requirements:
        raise RpojaxError.of_argument("until_decided", "found no requirements, expected some to decide")
    if not experiment_design.has_independent_runs(file):
        found = f"found a design of kind {file.design.kind!r}, expected independent runs, of which verdicts can be made"
        raise RpojaxError.of_argument("until_decided", found)


def _planned_bounds(requirement: RequirementSection, plan: SequentialPlan) -> PlannedBounds:
    stated = (requirement.metric_name, requirement.probability, requirement.consumer_risk)
    if _is_conditional(requirement):
        return PlannedBounds(*stated)
    bounds = look_bounds(plan.looks, plan.fractions, requirement.probability, requirement.consumer_risk)
    return PlannedBounds(*stated, tuple(each.allowed for each in bounds), tuple(each.refuting for each in bounds))


def _is_conditional(requirement: RequirementSection) -> bool:
    """Whether a requirement is on some of the runs alone."""
    return requirement.outcome is not None or requirement.is_of_reaching_runs


def look_path(
    requirement: RequirementSection,
    metrics: Mapping[str, np.ndarray],
    outcomes: np.ndarray,
    rows: np.ndarray,
    looks: Sequence[int],
) -> LookPath:
    """Runs that count and violations at every look of which all runs have ended.

    Args:
        requirement: that is looked at
        metrics: name -> (runs,) of the runs that have ended
        outcomes: (runs,) of these runs
        rows: (runs,) their places in the campaign, from 0
        looks: number of runs at each of all planned looks
    """
    ended = [look for look in looks if int(np.sum(rows < look)) == look]
    counted = counts(requirement, metrics, outcomes) if _is_conditional(requirement) else np.full(len(rows), True)
    violating = violates(requirement, required_values(requirement, metrics)) & counted
    return LookPath(
        runs=tuple(int(np.sum(counted & (rows < look))) for look in ended),
        fractions=tuple(look / looks[-1] for look in ended),
        violations=tuple(int(np.sum(violating & (rows < look))) for look in ended),
    )


def take_look(campaign: Campaign, number: int) -> Look:
    """Verdicts of look `number`, from 0, the runs of which have all ended, made by the campaign's own requirements."""
    plan = campaign.configuration.options.plan
    assert plan is not None
    first = campaign.configuration.options.first_run
    taken = (campaign.metrics, campaign.outcomes, campaign.run_ids - first, plan.looks)
    paths = [(each, look_path(each, *taken)) for each in campaign.file.requirements]
    return Look(plan.looks[number], tuple(_verdict(each, path, number + 1) for each, path in paths))


def _verdict(requirement: RequirementSection, path: LookPath, looks: int) -> LookVerdict:
    taken = LookPath(path.runs[:looks], path.fractions[:looks], path.violations[:looks])
    found = taken.decision(requirement.probability, requirement.consumer_risk)
    stated = f"{requirement.metric_name} {requirement.bound} {requirement.limit:g}"
    return LookVerdict(stated, taken.runs[-1], taken.violations[-1], _word(found))


def _word(found: Decision | None) -> str:
    if found is None:
        return look_records.OPEN
    return look_records.VERIFIED if found.verified else look_records.REFUTED


def blocks_by_look(campaign: Campaign) -> Iterator[list[int]]:
    """Missing blocks of one look after the other, until one decides; each look is recorded after its blocks have ended.

    Raises:
        UnfinishedError: a look cannot be recorded.
    """
    plan = campaign.configuration.options.plan
    assert plan is not None
    for number, look in enumerate(plan.looks):
        if number < len(campaign.looks):
            continue
        last = -(-look // campaign.configuration.block_size)
        yield [block for block in campaign.missing_blocks() if block < last]
        if any(block < last for block in campaign.missing_blocks()):
            return
        campaign.record_look(take_look(campaign, number))
        if campaign.has_ended:
            return
