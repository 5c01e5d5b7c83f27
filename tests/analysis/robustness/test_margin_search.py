"""The search for margins on functions with a known one."""

from collections.abc import Sequence

import pytest

from rpojax.analysis.robustness.margin_search import COARSE, FINEST, RESOLUTION, SideSearch, StepVerdict, search


def searched(limit: float, farthest: float = 100.0) -> SideSearch:
    """Search on a side that breaks beyond a limit."""
    side = SideSearch(farthest)
    search({"side": side}, lambda asked: [StepVerdict(("range",) if size > limit else ()) for _, size in asked])
    return side


@pytest.mark.parametrize("limit", [0.03, 0.3, 1.0, 1.7, 5.3, 15.9])
def test_the_margin_is_enclosed_to_a_tenth(limit: float) -> None:
    side = searched(limit)
    assert side.breaks is not None
    assert side.holds <= limit < side.breaks
    assert side.breaks - side.holds <= max(RESOLUTION * side.breaks, FINEST)
    assert side.requirement == "range"
    assert len(side.steps) <= len(COARSE) + 4


def test_a_side_that_never_breaks_ends_at_the_last_step() -> None:
    side = searched(1e9)
    assert [*side.steps] == [*COARSE]
    assert (side.breaks, side.requirement, side.holds) == (None, None, COARSE[-1])


def test_a_quantity_that_cannot_go_farther_is_stepped_to_its_end() -> None:
    assert [*searched(1e9, farthest=2.5).steps] == [1.0, 2.0, 2.5]
    assert [*searched(1e9, farthest=1.0).steps] == [1.0]
    assert searched(0.5, farthest=0.75).holds == pytest.approx(0.5, abs=FINEST)


def test_sides_are_asked_together_and_only_as_long_as_they_search() -> None:
    rounds: list[int] = []
    limits = {"near": 0.9, "far": 3.0, "none": 1e9}

    def evaluate(asked: Sequence[tuple[str, float]]) -> list[StepVerdict]:
        rounds.append(len(asked))
        return [StepVerdict(("limit",) if size > limits[side] else ()) for side, size in asked]

    sides = {name: SideSearch() for name in limits}
    search(sides, evaluate)
    assert rounds[0] == 3
    assert sum(rounds) == sum(len(side.steps) for side in sides.values())
    assert rounds == sorted(rounds, reverse=True)


def test_what_breaks_first_is_that_of_the_nearest_step_that_breaks() -> None:
    side = SideSearch()
    names = {True: ("far", "near"), False: ("near",)}
    search({"side": side}, lambda asked: [StepVerdict(names[s >= 4.0] if s > 2.5 else ()) for _, s in asked])
    assert side.requirement == "near"


def test_the_interval_has_the_steps_that_are_decided_with_confidence() -> None:
    side = SideSearch()
    search(
        {"side": side},
        lambda asked: [StepVerdict(("x",) if s > 3.0 else (), s >= 4.0, s <= 2.0) for _, s in asked],
    )
    assert side.interval == (2.0, 4.0)
    assert searched(3.0).interval == (None, None)
