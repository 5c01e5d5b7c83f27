"""Causes in navigation: wrong beliefs, gate, range that is not known, confidence that was withdrawn."""

import re
from collections.abc import Iterator
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes.finding import Depth, Finding, median, number, percent
from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers, RunEvidence
from rpojax.flight.navigation_health import TESTS
from rpojax.scenario.warnings.filter_beliefs import belief_warnings
from rpojax.simulation.metrics import failure_signs
from rpojax.simulation.outcomes.judgement import LEAST_COVERAGE

_BELIEVED_ELSEWHERE: Final = ("navigation.miss_probability", "chamber_pressure.enabled")
"""Beliefs of which missing and false boxes, and injected faults, tell more."""
_OUTSIDE: Final = 1.0 - LEAST_COVERAGE
"""Share of the time with an error outside of 3 sigma from which on a filter is wrong and sure of itself."""
_NEES: Final = 6.0 * 3.0
"""Mean relative NEES from which on it is, too."""
_REJECTED: Final = 0.25
"""Share of true boxes that the gate rejects from which on it is a cause. A choice: of `inspection` it is 1 %."""
_UNKNOWN: Final = 0.3
"""Sigma of the range over the range from which on burns are not planned by it; as `health.range_limit`."""
_UNCONFIDENT: Final = 0.5
"""Share of ten minutes without confidence that counts."""
_CERTAIN: Final = 2.0
_TRUTH: Final = re.compile(r"(?:the truth is|is up to|is down to|target\.scale is) ([0-9.e+-]+)")
"""Value of the truth in a warning about a belief."""
_ADVICE: Final = {
    "box_variance": "navigation.edge_noise_px and the beliefs of the target's shape that fit the boxes",
    "box_bias": "a calibration of the camera's mounting, or a larger navigation.bearing_bias_sigma_deg",
    "contradictions": "a wider navigation.gate_sigma, or beliefs that allow for what the boxes show",
    "size": "navigation.target_size_m that fits, or navigation.target_size_sigma above 0",
    "unseen": "more frames with the target: see light, lens and detector",
    "range": "a way on which the range shows, or health.range_limit",
    "control_effort": "beliefs of thrust and mass that fit (navigation.burn_scale_sigma)",
    "lasting": "larger sigmas of errors that last (mounting, thrust, size)",
}
"""What to look at after each health test."""
_SUSPECTS: Final = {
    "size": ("navigation.target_size",),
    "box_variance": ("navigation.edge_noise_px", "navigation.target_size"),
    "box_bias": ("navigation.bearing_bias_sigma_deg",),
    "contradictions": ("navigation.bearing_bias_sigma_deg", "navigation.target_size", "navigation.edge_noise_px"),
    "gps_variance": ("navigation.gps",),
    "control_effort": ("navigation.burn",),
    "lasting": ("navigation.burn", "navigation.bearing_bias_sigma_deg", "navigation.target_size"),
}
"""Begins of the keys of beliefs that a health test suspects when it fails."""


def findings(evidence: RunEvidence) -> Iterator[Finding]:
    """Findings of the runs."""
    yield from beliefs(evidence)
    yield sure_and_wrong(evidence)
    yield unknown_range(evidence)
    if evidence.has_signs:
        yield gate(evidence)
        yield from confidence(evidence)


def _wrongness(evidence: RunEvidence) -> Numbers:
    """(runs,) how far the filter is outside of what it believes: 1 where it is not consistent any more."""
    coverage, nees = evidence.metric("sigma3_coverage"), evidence.metric("nees_relative_mean")
    by_coverage = np.nan_to_num((1.0 - coverage) / _OUTSIDE, nan=0.0)
    by_nees = np.nan_to_num(nees / _NEES, nan=0.0)
    if evidence.has_signs:
        ticks = evidence.sign("ticks").sum(axis=1)
        by_coverage = np.maximum(
            by_coverage, evidence.sign("outside_3_sigma").sum(axis=1) / np.maximum(ticks, 1) / (2.0 * _OUTSIDE)
        )
    return np.maximum(by_coverage, by_nees)


def failed_tests(evidence: RunEvidence) -> Flags:
    """(runs, tests) whether a health test failed before the run did; none without signs."""
    if not evidence.has_signs:
        return np.zeros((evidence.count, len(TESTS)), dtype=bool)
    bits = np.bitwise_or.reduce(evidence.sign(failure_signs.FAILED_TESTS), axis=1)
    return np.asarray(bits[:, None] & (1 << np.arange(len(TESTS))) > 0)


def beliefs(evidence: RunEvidence) -> Iterator[Finding]:
    """Beliefs that the scenario itself contradicts, in runs whose filter shows it; the most suspicious ones first."""
    lines = [line for line in belief_warnings(evidence.file, evidence.reach) if not _is_elsewhere(line)]
    if not lines:
        return
    failed_of_run = failed_tests(evidence)
    shows = np.maximum(_wrongness(evidence), np.where(failed_of_run[:, 1:].any(axis=1), _CERTAIN, 0.0))
    if evidence.has_signs:
        rejected, _ = evidence.worst_share(evidence.sign("good_rejected"), evidence.sign("good_boxes"))
        shows = np.maximum(shows, rejected / _REJECTED)
    suspected = {key for place, test in enumerate(TESTS) if failed_of_run[:, place].any() for key in _suspects(test)}
    nowhere = np.full(evidence.count, np.nan)
    for line in sorted(lines, key=lambda each: not each.startswith(tuple(suspected) or ("?",)))[:1]:
        key, _, words = line.partition(": ")
        found = words.partition(", expected")[0]
        yield Finding(
            "belief",
            f"a wrong belief of {key}",
            Depth.ROOT,
            shows,
            nowhere,
            lambda _, key=key, found=found: f"{key} is wrong: {found}",
            lambda _, key=key, found=found: _fitting(key, found),
        )


def _fitting(key: str, words: str) -> str:
    """A belief that fits, by what a warning says of the truth."""
    value = _TRUTH.search(words)
    return f"a belief that fits ({key})" if value is None else f"{key} = {value.group(1)}"


def _suspects(test: str) -> tuple[str, ...]:
    return _SUSPECTS.get(test, ())


def _is_elsewhere(line: str) -> bool:
    return line.startswith(_BELIEVED_ELSEWHERE)


def sure_and_wrong(evidence: RunEvidence) -> Finding:
    """The filter is wrong and sure of itself, and no belief that the scenario contradicts tells why."""
    strength = _wrongness(evidence)
    coverage, nees = evidence.metric("sigma3_coverage"), evidence.metric("nees_relative_mean")
    tests = failed_tests(evidence)

    def words(chosen: Flags) -> str:
        return (
            f"the filter is wrong and sure of itself (inside 3 sigma in {percent(median(coverage, chosen))}, "
            f"NEES / 6 {number(median(nees, chosen) / 6.0)})"
        )

    def mend(chosen: Flags) -> str:
        return f"more doubt on board{_of_tests(tests, chosen)}: `rpojax robustness` tells which belief is narrowest"

    nowhere = np.full(evidence.count, np.nan)
    return Finding("sure_and_wrong", "the filter is wrong and sure", Depth.MECHANISM, strength, nowhere, words, mend)


def _of_tests(tests: Flags, chosen: Flags) -> str:
    """Which health test failed most often in some runs, in brackets; empty without one."""
    counts = tests[chosen].sum(axis=0)
    return f" (the test {TESTS[int(np.argmax(counts))]} failed)" if counts.any() else ""


def unknown_range(evidence: RunEvidence) -> Finding:
    """The range is not known well enough to burn by it."""
    sigma = evidence.trace("nav_relative_sigma3_m") / 3.0
    ratio = sigma / np.maximum(evidence.trace("range_m"), 1e-3)
    limit = min(_UNKNOWN, evidence.file.formation.range_uncertainty_limit)
    known = np.isfinite(ratio)
    above = known & (ratio > limit)
    share = above.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    worst = np.max(np.where(known, ratio, 0.0), axis=1, initial=0.0)

    def words(chosen: Flags) -> str:
        return (
            f"the range is known to {percent(median(worst, chosen))} only, and no burn is planned beyond "
            f"{percent(limit)} ({percent(median(share, chosen))} of the time)"
        )

    at_s = evidence.first_s(above)
    return Finding(
        "unknown_range",
        "the range is not known",
        Depth.MECHANISM,
        share / 0.2,
        at_s,
        words,
        lambda _: "more frames with the target, or a way on which its range shows (radial or cross-track motion)",
        is_loss=True,
    )


def gate(evidence: RunEvidence) -> Finding:
    """The gate rejects true boxes."""
    share, at_s = evidence.worst_share(evidence.sign("good_rejected"), evidence.sign("good_boxes"))
    sigma = evidence.file.navigation.gate_sigma

    def words(chosen: Flags) -> str:
        return (
            f"the gate of {number(sigma)} sigma rejects {percent(median(share, chosen))} of true boxes in ten minutes"
        )

    def mend(_: Flags) -> str:
        return f"navigation.gate_sigma = {number(sigma + 1.0)}, or beliefs that allow for what the boxes show"

    return Finding("gate", "the gate rejects true boxes", Depth.MECHANISM, share / _REJECTED, at_s, words, mend)


def confidence(evidence: RunEvidence) -> Iterator[Finding]:
    """Confidence was withdrawn for long, one finding for each health test that failed first."""
    share, at_s = evidence.worst_share(evidence.sign("unconfident"), evidence.sign("ticks"))
    bits = evidence.sign(failure_signs.FAILED_TESTS)
    unconfident = evidence.sign("unconfident") > 0
    first = np.argmax(unconfident, axis=1)
    at_first = bits[np.arange(evidence.count), first] & ~1
    for place in range(1, len(TESTS)):
        of_test = unconfident.any(axis=1) & ((at_first >> place) & 1 > 0)
        if not of_test.any():
            continue

        def words(chosen: Flags, place: int = place) -> str:
            since = median(evidence.interval_s * first.astype(float), chosen)
            return (
                f"navigation lost its confidence near {number(since)} s by the test {TESTS[place]} "
                f"({percent(median(share, chosen))} of ten minutes without it)"
            )

        yield Finding(
            "confidence",
            f"confidence lost by the test {TESTS[place]}",
            Depth.CONSEQUENCE,
            np.where(of_test, share / _UNCONFIDENT, 0.0),
            at_s,
            words,
            lambda _, place=place: _ADVICE[TESTS[place]],
            is_loss=True,
        )
