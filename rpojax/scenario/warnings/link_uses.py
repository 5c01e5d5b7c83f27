"""Whether what the servicers of a team send can arrive, and in time for what uses it."""

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def link_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Links over which nothing, or one message at most, arrives, outages after the run, and limits of age too low."""
    link, found = file.link, []
    if file.navigation.sharing in ("none", "central"):
        return []
    has_bursts = reach.low("link.burst_interval_s") < file.duration_s
    if reach.low("link.loss") >= 1.0 and not (has_bursts and reach.low("link.burst_loss") < 1.0):
        found.append("link.loss: found 1, expected less: no message arrives, and what is shared has no effect")
    # Periods and delays are whole ticks, which no run varies.
    if link.period_s >= file.duration_s:
        found.append(
            f"link.period_s: found {link.period_s:g} s, expected less than duration_s = {file.duration_s:g}: "
            "a servicer sends one message at most"
        )
    late = [window for window in link.outages_s if window[0] >= file.duration_s]
    if late:
        found.append(
            f"link.outages_s: found {late[0]}, expected one that begins before the end of the run, "
            f"duration_s = {file.duration_s:g}: it has no effect"
        )
    age = link.period_s + link.delay_s
    if file.team.phasing != "fixed" and (lost := reach.low("team.lost_after_s")) < age:
        found.append(
            f"team.lost_after_s: found {lost:g} s, expected at least {age:g}, link.period_s and delay_s together: "
            "the others count as lost between two messages"
        )
    return found
