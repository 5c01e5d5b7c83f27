"""Outcome of a campaign, as the first screen shows it: sentence, verdicts, three figures, what to look at next."""
