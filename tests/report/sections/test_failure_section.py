"""Failure reasons and the inputs that distinguish failed runs."""

from rpojax.report.sections import failure_section


def test_distinguishing_inputs_are_named_for_each_outcome(build):
    failed = tuple(range(0, 60, 3))
    campaign = build(runs=200, seconds=60, kept=(), failed=failed)
    campaign.drawn["gps.noise_m"][list(failed)] += 5.0
    campaign.outcomes[0] = "non_finite"
    found = failure_section.content(campaign)
    assert [(one["outcome"], one["reason"], one["runs"]) for one in found] == [
        ("keep_out", "entered the keep-out sphere", 19),
        ("non_finite", "non-finite state", 1),
    ]
    first = found[0]["inputs"][0]
    assert (first["input"], first["ks"], first["auc"]) == ("gps.noise_m", 1.0, 1.0)
    assert first["ks_p"] < 1e-6
    assert failure_section.cause_sentence(found[0]).endswith("completed runs: gps.noise_m.")
    assert failure_section.cause_rows(found[0])[0][:2] == ["gps.noise_m", "greater"]
    # One run alone proves nothing: its rank among 181 has at best a p-value of about 0.01, times five inputs.
    assert (
        failure_section.cause_sentence(found[1]) == "No input differs significantly between these and completed runs."
    )
