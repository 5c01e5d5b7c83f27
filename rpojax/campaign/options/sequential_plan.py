"""Plan of a campaign that ends as soon as its requirements are decided: its looks, stated before. Free of numpy."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from rpojax.errors import RpojaxError

RULE: Final = (
    "Group-sequential: at each look the runs so far verify a requirement with at most the allowed violations and "
    "refute it with at least the refuting ones; each risk is spent as the power 0.3 of the fraction of the plan."
)
"""The rule in words, as campaign.json records it."""


@dataclass(frozen=True)
class PlannedBounds:
    """Bounds of the violations of a requirement at the looks, None where a look cannot give that verdict.

    They are empty for a requirement on some of the runs: its bounds follow from the number of runs that count.
    """

    metric: str
    probability: float
    consumer_risk: float
    allowed: tuple[int | None, ...] = ()
    refuting: tuple[int | None, ...] = ()


@dataclass(frozen=True)
class SequentialPlan:
    """When the verdicts of a campaign are looked at.

    Attributes:
        looks: number of runs at each, the last one being all that there may be
        bounds: of each requirement
    """

    looks: tuple[int, ...]
    bounds: tuple[PlannedBounds, ...] = ()

    @property
    def fractions(self) -> tuple[float, ...]:
        """Fraction of the plan at each look."""
        return tuple(look / self.looks[-1] for look in self.looks)

    def to_record(self) -> dict[str, Any]:
        """Entry `sequential` of campaign.json."""
        bounds = [
            {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(bound).items()}
            for bound in self.bounds
        ]
        return {"looks": list(self.looks), "rule": RULE, "bounds": bounds}

    @classmethod
    def from_record(cls, record: Any, runs: int) -> "SequentialPlan":
        """Plan from the entry of campaign.json.

        Raises:
            RpojaxError: it is no plan of a campaign of at most that many runs.
        """
        looks = record.get("looks") if isinstance(record, Mapping) else None
        numbers = isinstance(looks, list) and all(isinstance(look, int) for look in looks)
        if not numbers or not looks or [*looks] != sorted({0, *looks})[1:] or looks[-1] != runs:
            raise RpojaxError.of_argument("sequential", f"found looks {looks!r:.60}, expected rising ones up to {runs}")
        try:
            bounds = tuple(_bounds_of_record(one) for one in record.get("bounds", []))
        except (KeyError, TypeError, ValueError):
            raise RpojaxError.of_argument("sequential", "found other bounds, expected those of a plan") from None
        return cls(tuple(looks), bounds)


def _bounds_of_record(record: Mapping[str, Any]) -> PlannedBounds:
    stated = str(record["metric"]), float(record["probability"]), float(record["consumer_risk"])
    allowed, refuting = (
        tuple(None if count is None else int(count) for count in record[key]) for key in ("allowed", "refuting")
    )
    return PlannedBounds(*stated, allowed, refuting)
