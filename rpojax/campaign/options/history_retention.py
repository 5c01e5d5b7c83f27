"""Rules for the runs of a campaign that keep a history, such as `8+failures+worst:5:min_range_m`, and its thinning."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from rpojax.errors import RpojaxError

RULE_FORMS = (
    "none, all, N (the first N), I,J,... (run numbers), every:N, failures, worst:K:METRIC, requirements, "
    "or several joined by '+'"
)
_ALWAYS_KEPT = ("time_s", "rho_desired_H")


ChannelNames = Annotated[
    tuple[str, ...] | None,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="A,B,...",
        instance_from_str=lambda words: tuple(filter(None, words[0].split(","))),
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda names: [",".join(names or ())],
    ),
]
"""Names of channels, on the command line with commas between them; None for all."""


@dataclass(frozen=True)
class Retention:
    """Retention rule of histories.

    Attributes:
        rule: which runs keep a history, one of `RULE_FORMS`
        channels: which channels are kept, None for all
        every: ticks from one kept sample to the next

    Raises:
        RpojaxError: the rule has none of the forms, or `every` is not positive.
    """

    rule: Annotated[
        str,
        arg(
            name="histories",
            metavar="RULE",
            help="Histories to keep: none, all, N (the first N runs), I,J,... (run numbers), every:N, failures, "
            "worst:K:METRIC, requirements (the worst run of each), or several joined by +.",
        ),
    ]
    channels: Annotated[
        ChannelNames,
        arg(name="history-channels", help="Channels to keep of a history.", help_behavior_hint="(default: all)"),
    ] = None
    every: Annotated[
        int,
        arg(name="history-every", metavar="N", help="Ticks from one kept sample of a history to the next."),
    ] = 1

    def __post_init__(self) -> None:
        for term in self._terms():
            _parse_term(term)
        if self.every < 1:
            raise RpojaxError.of_argument("history_every", f"found {self.every}, expected at least 1")

    @classmethod
    def from_run_ids(cls, run_ids: Sequence[int]) -> "Retention":
        """Rule that lists run numbers."""
        return cls(",".join(map(str, sorted(set(run_ids)))) + "," if len(run_ids) else "none")

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Retention":
        """Rule from its record in `campaign.json`."""
        channels = record["channels"]
        return cls(record["rule"], None if channels is None else tuple(channels), record["every"])

    def to_record(self) -> dict[str, Any]:
        """Record for `campaign.json`."""
        channels = None if self.channels is None else list(self.channels)
        return {"rule": self.rule, "channels": channels, "every": self.every}

    def _terms(self) -> list[str]:
        return [term.strip() for term in self.rule.split("+")]

    def check_run_ids(self, first_run: int, runs: int) -> None:
        """Refuses run numbers outside of the campaign.

        Raises:
            RpojaxError: naming the run.
        """
        for kind, numbers, _ in map(_parse_term, self._terms()):
            for number in numbers if kind == "runs" else ():
                if not first_run <= number < first_run + runs:
                    raise RpojaxError.of_argument("histories", f"found run {number}, expected runs of this campaign")

    def unconditional_run_ids(self, first_run: int, runs: int) -> set[int]:
        """Numbers of the runs whose histories are kept independently of their results."""
        kept: set[int] = set()
        for kind, numbers, _ in map(_parse_term, self._terms()):
            match kind:
                case "all":
                    kept.update(range(first_run, first_run + runs))
                case "first":
                    kept.update(range(first_run, first_run + min(numbers[0], runs)))
                case "every":
                    kept.update(range(first_run, first_run + runs, numbers[0]))
                case "runs":
                    kept.update(numbers)
        return kept

    @property
    def depends_on_results(self) -> bool:
        """Whether some histories are kept because of the results of their runs."""
        return self.keeps_failures or self.keeps_requirements or bool(self.worst_kept)

    @property
    def keeps_requirements(self) -> bool:
        """Whether the history of the worst run of each requirement of the scenario is kept."""
        return any(kind == "requirements" for kind, _, _ in map(_parse_term, self._terms()))

    @property
    def keeps_failures(self) -> bool:
        """Whether the histories of all failed runs are kept."""
        return any(kind == "failures" for kind, _, _ in map(_parse_term, self._terms()))

    @property
    def worst_kept(self) -> list[tuple[str, int]]:
        """Metrics of which the worst runs keep a history, each with their number."""
        terms = map(_parse_term, self._terms())
        return [(metric, numbers[0]) for kind, numbers, metric in terms if kind == "worst"]

    def max_histories(self, first_run: int, runs: int, requirements: int = 0) -> int:
        """Largest number of histories, failures excluded, of a scenario with that number of `requirements`."""
        selected = sum(count for _, count in self.worst_kept) + (requirements if self.keeps_requirements else 0)
        return min(runs, len(self.unconditional_run_ids(first_run, runs)) + selected)

    def keeps_channel(self, channel: str) -> bool:
        """Whether a channel is kept."""
        return self.channels is None or channel in (*_ALWAYS_KEPT, *self.channels)


def check_channels(channels: Sequence[str] | None, known: Sequence[str]) -> None:
    """Refuses channels that a history does not have.

    Raises:
        RpojaxError: naming the channel, and a known one with a similar name.
    """
    for name in channels or ():
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise RpojaxError.of_argument("history_channels", f"found {name!r}, expected channels of a history{hint}")


def _parse_term(term: str) -> tuple[str, list[int], str]:
    """Kind of a term, its numbers and its metric.

    Raises:
        RpojaxError: it has none of the forms.
    """
    kind, *rest = term.split(":")
    if term in ("none", "all", "failures", "requirements"):
        return term, [], ""
    if kind == "every" and len(rest) == 1:
        return kind, [_parse_number(rest[0], term, 1)], ""
    if kind == "worst" and len(rest) == 2:
        # Imported here because the help of the command line does without numpy.
        from rpojax.metrics.metric_catalogue import UNITS, is_of_campaigns
        from rpojax.scenario.plugins import plugin_registry

        # A plugin's metrics become known when the scenario is loaded; the campaign checks them before it compiles.
        if not is_of_campaigns(rest[1]) and not (rest[1].isidentifier() and plugin_registry.is_permitted()):
            close = difflib.get_close_matches(rest[1], UNITS, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise RpojaxError.of_argument("histories", f"found metric {rest[1]!r}, expected one of a campaign{hint}")
        return kind, [_parse_number(rest[0], term, 1)], rest[1]
    if "," in term:
        return "runs", [_parse_number(part, term, 0) for part in term.split(",") if part.strip()], ""
    return "first", [_parse_number(term, term, 0)], ""


def _parse_number(text: str, term: str, least: int) -> int:
    digits = text.strip()
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 10 and int(digits) >= least):
        raise RpojaxError.of_argument("histories", f"found {term!r}, expected {RULE_FORMS}")
    return int(digits)
