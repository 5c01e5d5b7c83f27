"""Caveats: what the results do not cover."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpojax.report.campaign_results import CampaignResults, design_phrase, runs_are_independent
from rpojax.report.labels import format_number, in_display_order, metric_label, of_all_servicers


def caveat_sentences(campaign: CampaignResults, summary: Mapping[str, Any]) -> list[str]:
    """Sentences on the limits of the results; `summary` is that of the campaign."""
    scenario, runs = campaign.info.get("scenario", {}), summary["runs"]
    sentences = [*_seal_caveats(campaign), _camera_caveat(scenario.get("camera"))]
    if "duration_s" in scenario:
        duration = format_number(float(scenario["duration_s"]))
        sentences.append(f"Each run lasts {duration} s; nothing is said about later times.")
    sentences.append(
        "From run to run vary the quantities under Dispersions, the error of the hand-over, the execution errors of "
        "burns, and the noise and slowly varying errors of the sensors; nothing else does. "
        "A model error that simulation and flight software share does not show."
    )
    if runs["missing"]:
        sentences.append(f"{runs['missing']} of {runs['requested']} runs are missing; nothing here is about them.")
    ended = int(np.sum(campaign.reached_end))
    if runs["requested"] == 1:
        sentences.append("One run says nothing about how likely any of this is.")
    elif ended < 299 and runs_are_independent(campaign):
        sentences.append(
            f"{ended} runs that reached their end cannot bound a 99th percentile without assuming a distribution "
            "(299 are needed for 95 % confidence); p99 is then a description of these runs only."
        )
    if unjudged := int(np.sum(~campaign.is_judged)):
        sentences.append(
            f"{unjudged} runs were recorded by an older version, which counted a run as completed unless its state "
            "became non-finite or it entered the keep-out sphere; whether they were lost or off station is not judged."
        )
    sentences += _undefined_metrics_caveats(campaign)
    sentences.append(_independence_caveat(campaign))
    if not summary["requirements"]:
        sentences.append("The campaign states no requirements, so this report gives no verdict.")
    elif runs["missing"]:
        sentences.append(
            "Requirements are judged when all runs have ended: those that are missing may be the bad ones."
        )
    elif runs_are_independent(campaign):
        sentences.append(
            "A verdict is about runs drawn as the scenario declares, with the consumer's risk stated for each "
            "requirement alone: with several requirements the risk that one of them is verified wrongly is greater. "
            "It is also for a number of runs fixed beforehand: who adds runs until it verifies bears a greater risk."
        )
    return sentences


def _undefined_metrics_caveats(campaign: CampaignResults) -> list[str]:
    """Sentences on metrics that are undefined in some runs; a metric defined in no run needs none."""
    ended = np.asarray(campaign.reached_end, dtype=bool)
    frozen = int(np.sum(~ended))
    undefined = {
        name: int(np.sum(ended & ~np.isfinite(campaign.metrics[name])))
        for name in of_all_servicers(in_display_order(campaign.metrics))
    }
    partly = [name for name, count in undefined.items() if 0 < count < int(ended.sum())]
    sentences = [
        "Metrics are those of all runs that reached their end, whatever their outcome: of lost and diverged ones too."
    ]
    if not frozen and not partly:
        return sentences
    sentences.append(
        "They leave out runs in which they are undefined, as after an entry into the keep-out sphere: "
        "they describe the other runs and must be read together with the failures. "
        "Only the bounds of p99 and p1 count runs without a value, as worse than any other."
    )
    if partly:
        named = ", ".join(f"{metric_label(name).title} ({undefined[name]})" for name in partly)
        sentences.append(
            f"Undefined in some of the {int(ended.sum())} runs that reached their end: {named}. That is no failure "
            "where there was nothing to measure, but the bounds take the worse case: none is given that would be such "
            "a run."
        )
    return sentences


def _seal_caveats(campaign: CampaignResults) -> list[str]:
    """Sentences on a folder without a seal, and on requirements that were changed after the campaign."""
    sentences = []
    if not campaign.info.get("sealed", True):
        sentences.append(
            "The folder is unsealed: it was made before digests bound scenario, runs and results together, so nothing "
            "shows whether its identity or its requirements were changed. Figures are given, verdicts are not."
        )
    for change in campaign.info.get("requirement_changes", []):
        listed = "; ".join(
            f"{item.get('metric')} {item.get('bound')} {item.get('limit')} with probability {item.get('probability')}"
            for item in change["requirements"]
        )
        sentences.append(
            f"Requirements were changed after the campaign on {change['changed']} ({change['reason']}). Since then "
            f"they are: {listed or 'none'}."
        )
    return sentences


def _independence_caveat(campaign: CampaignResults) -> str:
    if runs_are_independent(campaign):
        return "Intervals and bounds take the runs as independent: each with its own random draws."
    return (
        f"The runs follow {design_phrase(campaign)} and are not independent of one another. Exact intervals, bounds, "
        "p-values and verdicts rest on independence and are therefore left out."
    )


def _camera_caveat(camera: Any) -> str:
    model = camera.get("model") if isinstance(camera, Mapping) else None
    texts = {
        "geometric": "boxes are computed from the geometry of the target with modelled errors. No image is rendered "
        "and no detector runs, so nothing is said about appearance, exposure or clutter",
        "statistical": "boxes are drawn from an error model of the detector. No image is rendered, so nothing is said "
        "about images unlike those from which the model was made",
        "rendered": "images are rendered and a trained detector finds the boxes. Results hold as far as the rendered "
        "images are like real ones",
    }
    if model not in texts:
        return "The scenario names no known camera model; how boxes were made must be looked up in the scenario."
    return f"The camera model is {model}: {texts[model]}."
