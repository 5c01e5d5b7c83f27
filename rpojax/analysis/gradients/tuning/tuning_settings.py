"""Settings of a tuning: one record for the command line, for Python and for the file of its steps. Free of jax."""

import math
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from tyro.conf import Fixed, arg

from rpojax.errors import RpojaxError


@dataclass(frozen=True)
class TuningSettings:
    """Settings of a tuning.

    The command `rpojax tune` has the fields as options, and `parameters` in its own form.

    Attributes:
        parameters: names of groups (navigation, pose, gate, formation, attitude, schedule) and scenario keys
        runs: per step
        steps: of the descent
        horizon_s: simulated time of a run [s]; None for 2000 s at most, of several phases for all of them
        rate: size of the first steps, in logarithms of the numbers
        validation_runs: unseen full runs, of seed `seed + 1`; 0 for no validation
        seed: master seed; step n simulates runs n * runs and on

    Raises:
        RpojaxError: a number is out of range.
    """

    parameters: Fixed[tuple[str, ...]] = ("navigation",)
    runs: Annotated[int, arg(metavar="N", help="Runs per step.")] = 64
    steps: Annotated[int, arg(metavar="N", help="Steps.")] = 80
    horizon_s: Annotated[
        float | None,
        arg(
            name="horizon",
            metavar="T",
            help="Simulated time of a run [s].",
            help_behavior_hint="(default: 2000, or all of a mission of phases)",
        ),
    ] = None
    rate: Annotated[float, arg(metavar="R", help="Size of the first steps; 0.2 is about twenty per cent.")] = 0.2
    validation_runs: Annotated[
        int, arg(name="judge", metavar="N", help="Unseen full runs to validate the result with; 0 for none.")
    ] = 500
    seed: Annotated[int, arg(metavar="S", help="Master seed.")] = 0

    def __post_init__(self) -> None:
        for name, is_valid, expected in (
            ("runs", self.runs >= 1, "at least 1"),
            ("steps", self.steps >= 1, "at least 1"),
            ("horizon_s", self.horizon_s is None or 0.0 < self.horizon_s < math.inf, "a time above 0 s"),
            ("rate", 0.0 < self.rate <= 1.0, "a number above 0 and up to 1"),
            ("validation_runs", self.validation_runs == 0 or self.validation_runs >= 2, "0 or at least 2"),
            ("seed", 0 <= self.seed < 2**63, "a number from 0"),
        ):
            if not is_valid:
                raise RpojaxError.of_argument(name, f"found {getattr(self, name)}, expected {expected}")

    def descent_record(self) -> dict[str, Any]:
        """What the descent depends on, in the types of JSON: all but the validation."""
        record = asdict(self)
        del record["validation_runs"]
        return record | {"parameters": list(self.parameters)}
