"""Causes in navigation: wrong beliefs, gate, range that is not known, confidence that was withdrawn."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from rpojax.analysis.failure_causes.belief_mends import belief_mend, believed_text
from rpojax.analysis.failure_causes.finding import Depth, Finding, median, number, percent
from rpojax.analysis.failure_causes.present_values import change
from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers, RunEvidence
from rpojax.flight.navigation_health import TESTS
from rpojax.scenario.warnings.filter_beliefs import belief_warnings, is_conservative
from rpojax.simulation.metrics import failure_signs
from rpojax.simulation.outcomes.judgement import LEAST_COVERAGE

_BELIEVED_ELSEWHERE: Final = ("navigation.miss_probability", "chamber_pressure.enabled")
"""Beliefs of which missing and false boxes, and injected faults, tell more."""
_ABSOLUTE: Final = "navigation.gps"
"""Begin of the keys of beliefs on which the relative estimate does not depend by itself."""
_OUTSIDE: Final = 1.0 - LEAST_COVERAGE
"""Share of the time with an error outside of 3 sigma from which on a filter is wrong and sure of itself."""
_NEES: Final = 6.0 * 3.0
"""Mean relative NEES from which on it is, too."""
_REJECTED: Final = 0.25
"""Share of true boxes that the gate rejects from which on it is a cause. A choice: of `inspection` it is 1 %."""
_UNCONFIDENT: Final = 0.5
"""Share of ten minutes without confidence that counts."""
_CERTAIN: Final = 2.0
ADVICE: Final = {
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
    "box_variance": ("navigation.edge_noise_px", "navigation.target_size", "attitude_filter.star_tracker_noise_deg"),
    # Of a box the size has a mean, too, by which a wrong size shows as well as a mounting.
    "box_bias": (
        "navigation.bearing_bias_sigma_deg",
        "navigation.target_size",
        "navigation.initial_relative",
        "attitude_filter.star_tracker_noise_deg",
    ),
    "contradictions": (
        "navigation.bearing_bias_sigma_deg",
        "navigation.target_size",
        "navigation.edge_noise_px",
        "navigation.initial_relative",
    ),
    "gps_variance": (_ABSOLUTE,),
    "control_effort": ("navigation.burn", "navigation.thrust", "navigation.pressure_noise"),
    "lasting": (
        "navigation.burn",
        "navigation.thrust",
        "navigation.ballistic",
        "navigation.bearing_bias_sigma_deg",
        "navigation.target_size",
    ),
}
"""Begins of the keys of beliefs that a health test suspects when it fails; `unseen` and `range` suspect none."""


def findings(evidence: RunEvidence) -> Iterator[Finding]:
    """Findings of the runs."""
    yield from beliefs(evidence)
    yield sure_and_wrong(evidence)
    yield unknown_range(evidence)
    if evidence.has_signs:
        yield gate(evidence)
        yield from confidence(evidence)


def _consistency(evidence: RunEvidence) -> tuple[Numbers, Numbers]:
    """(runs,) share of the time inside of 3 sigma and mean relative NEES: metrics, until an abort signs and traces.

    Until an abort, the share is of the time in which all three axes are inside.
    """
    coverage, nees = evidence.metric("sigma3_coverage"), evidence.metric("nees_relative_mean")
    if not evidence.goes_on.any():
        return coverage, nees
    samples = evidence.trace("nees_relative")
    known = np.isfinite(samples)
    mean = np.sum(samples, axis=1, where=known) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    return np.where(evidence.goes_on, 1.0 - _outside(evidence), coverage), np.where(evidence.goes_on, mean, nees)


def _outside(evidence: RunEvidence) -> Numbers:
    """(runs,) share of the time with an axis outside of 3 sigma, NaN without signs."""
    if not evidence.has_signs:
        return np.full(evidence.count, np.nan)
    return evidence.sign("outside_3_sigma").sum(axis=1) / np.maximum(evidence.sign("ticks").sum(axis=1), 1)


def _wrongness(evidence: RunEvidence) -> Numbers:
    """(runs,) how far the filter is outside of what it believes: 1 where it is not consistent any more."""
    coverage, nees = _consistency(evidence)
    by_coverage = np.where(evidence.goes_on, 0.0, (1.0 - coverage) / _OUTSIDE)
    shares = (by_coverage, nees / _NEES, _outside(evidence) / (2.0 * _OUTSIDE))
    return np.max(np.nan_to_num(shares, nan=0.0), axis=0)


def _wrong_since_s(evidence: RunEvidence) -> Numbers:
    """(runs,) since when the filter is outside of what it believes [s], NaN where unknown."""
    by_nees = evidence.first_s(evidence.trace("nees_relative") > _NEES)
    if not evidence.has_signs:
        return by_nees
    _, outside_s = evidence.worst_share(evidence.sign("outside_3_sigma"), evidence.sign("ticks"))
    return np.fmin(outside_s, by_nees)


def failed_tests(evidence: RunEvidence) -> Flags:
    """(runs, tests) whether a health test failed before the run did; none without signs."""
    if not evidence.has_signs:
        return np.zeros((evidence.count, len(TESTS)), dtype=bool)
    bits = np.bitwise_or.reduce(evidence.sign(failure_signs.FAILED_TESTS), axis=1)
    return np.asarray(bits[:, None] & (1 << np.arange(len(TESTS))) > 0)


def tests_failed_last(evidence: RunEvidence) -> Flags:
    """(runs, tests) the health tests that failed in the last interval in which one did; none without signs.

    That of GPS does not count, as confidence does not depend on it.
    """
    if not evidence.has_signs:
        return np.zeros((evidence.count, len(TESTS)), dtype=bool)
    bits = evidence.sign(failure_signs.FAILED_TESTS) & ~1
    last = bits.shape[1] - 1 - np.argmax(bits[:, ::-1] > 0, axis=1)
    return np.asarray(bits[np.arange(len(bits)), last][:, None] & (1 << np.arange(len(TESTS))) > 0)


def most_common(tests: Flags, chosen: Flags) -> list[str]:
    """Names of the tests (runs, tests) that most of some runs failed, those that come out even all; none without."""
    counts = tests[chosen].sum(axis=0)
    return [test for test, count in zip(TESTS, counts, strict=True) if 0 < count == counts.max()]


def beliefs(evidence: RunEvidence) -> Iterator[Finding]:
    """Beliefs that the scenario itself contradicts, in runs whose filter shows it; those that a test suspects first.

    A run shows a belief where a health test failed that suspects it, or where the filter is wrong and sure of itself or
    rejects true boxes. Too much doubt does none of these.
    """
    lines = [line for line in belief_warnings(evidence.file, evidence.reach) if not _is_elsewhere(line)]
    shown = [(line, *_shown(evidence, line)) for line in lines if not is_conservative(line)]
    for line, strength, at_s in sorted(shown, key=lambda each: -float(each[1].sum())):
        key, _, words = line.partition(": ")
        found = words.partition(", expected")[0]
        yield Finding(
            "belief",
            f"a wrong belief of {key}",
            Depth.ROOT,
            strength,
            at_s,
            lambda _, key=key, found=found: f"a wrong belief of {key}: {believed_text(evidence.file, key, found)}",
            lambda _, key=key, found=found: belief_mend(evidence.file, evidence.reach, key, found),
        )


def _shown(evidence: RunEvidence, line: str) -> tuple[Numbers, Numbers]:
    """(runs,) how strongly the filter shows that the belief of a warning is wrong, and since when [s]."""
    wrongness, wrong_s = _wrongness(evidence), _wrong_since_s(evidence)
    if not evidence.has_signs:
        return wrongness, wrong_s
    mask = sum(1 << place for place, test in enumerate(TESTS) if line.startswith(_SUSPECTS.get(test, ("?",))))
    suspected = evidence.sign(failure_signs.FAILED_TESTS) & mask > 0
    by_test, test_s = np.where(suspected.any(axis=1), _CERTAIN, 0.0), evidence.first_interval_s(suspected)
    if line.startswith(_ABSOLUTE):
        return np.minimum(by_test, wrongness), np.maximum(test_s, wrong_s)
    rejected, rejected_s = evidence.worst_share(evidence.sign("good_rejected"), evidence.sign("good_boxes"))
    signs = ((wrongness, wrong_s), (by_test, test_s), (rejected / _REJECTED, rejected_s))
    times = np.array([np.where(strength >= 1.0, at_s, np.nan) for strength, at_s in signs])
    return np.max([strength for strength, _ in signs], axis=0), np.fmin.reduce(times)


def _is_elsewhere(line: str) -> bool:
    return line.startswith(_BELIEVED_ELSEWHERE)


def sure_and_wrong(evidence: RunEvidence) -> Finding:
    """The filter is wrong and sure of itself, and no belief that the scenario contradicts tells why."""
    strength = _wrongness(evidence)
    coverage, nees = _consistency(evidence)
    tests = failed_tests(evidence)

    def words(chosen: Flags) -> str:
        return (
            f"the filter is wrong and sure of itself (inside 3 sigma in {percent(median(coverage, chosen))}, "
            f"NEES / 6 {number(median(nees, chosen) / 6.0)})"
        )

    def mend(chosen: Flags) -> str:
        return f"more doubt on board{_of_tests(tests, chosen)}: `rpojax robustness` tells which belief is narrowest"

    title, since_s = "the filter is wrong and sure", _wrong_since_s(evidence)
    return Finding("sure_and_wrong", title, Depth.MECHANISM, strength, since_s, words, mend)


def _of_tests(tests: Flags, chosen: Flags) -> str:
    """Which test of what the filter believes failed most often in some runs, in brackets; empty without one."""
    counts = np.where([test in _SUSPECTS for test in TESTS], tests[chosen].sum(axis=0), 0)
    return f" (the test {TESTS[int(np.argmax(counts))]} failed)" if counts.any() else ""


def unknown_range(evidence: RunEvidence) -> Finding:
    """The range is not known well enough to burn by it."""
    sigma = evidence.trace("nav_relative_sigma3_m") / 3.0
    ratio = sigma / np.maximum(evidence.trace("range_m"), 1e-3)
    of_burns, of_health = evidence.value("formation.range_uncertainty_limit"), evidence.value("health.range_limit")
    limit = np.minimum(of_burns, of_health)
    known = np.isfinite(ratio)
    above = known & (ratio > limit[:, None])
    share = above.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    worst = np.max(np.where(known, ratio, 0.0), axis=1, initial=0.0)

    def words(chosen: Flags) -> str:
        ends_burns = median(of_burns, chosen) <= median(of_health, chosen)
        what = "no burn is planned" if ends_burns else "navigation has no confidence"
        return (
            f"the range is known to {percent(median(worst, chosen))} only, and {what} beyond "
            f"{percent(median(limit, chosen))} ({percent(median(share, chosen))} of the time)"
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
            f"the gate of {number(sigma)} sigma rejects {percent(median(share, chosen))} of true boxes in the "
            "worst ten minutes"
        )

    def mend(_: Flags) -> str:
        wider = change(evidence.file, "navigation.gate_sigma", sigma + 1.0)
        return f"{wider}, or beliefs that allow for what the boxes show"

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
                f"({percent(median(share, chosen))} of the worst ten minutes without it)"
            )

        yield Finding(
            "confidence",
            f"confidence lost by the test {TESTS[place]}",
            Depth.CONSEQUENCE,
            np.where(of_test, share / _UNCONFIDENT, 0.0),
            at_s,
            words,
            lambda _, place=place: ADVICE[TESTS[place]],
            is_loss=True,
        )
