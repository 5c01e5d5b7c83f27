"""Burns after an abort: one, and others only for what was measured since."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.flight.mission import abort_burn
from rpojax.flight.mission.abort_burn import MOST_BURNS, AbortBurnReason, AbortBurns

permission, recorded = jax.jit(abort_burn.permission), jax.jit(abort_burn.recorded)


def decide(
    burns: AbortBurns, planned: bool = True, works: bool = True, sees: bool = False, was_made: bool = True
) -> tuple[AbortBurns, bool]:
    """Record after a decision at which a burn is planned if it is allowed, and whether it was."""
    allowed = permission(burns, jnp.asarray(True), jnp.asarray(works), jnp.asarray(sees), jnp.asarray(was_made))
    burn = planned and bool(allowed.of_abort | allowed.of_sight)
    return recorded(burns, allowed, jnp.asarray(burn), jnp.asarray(was_made)), burn


def summary(burns: AbortBurns) -> tuple[int, int]:
    return int(burns.count), int(burns.reason)


def test_a_blind_servicer_makes_one_burn_however_long_it_drifts() -> None:
    burns, made = abort_burn.none(), 0
    for _ in range(200):
        burns, burn = decide(burns)
        made += burn
    assert made == 1
    assert summary(burns) == (1, AbortBurnReason.ABORT)


def test_a_drift_that_was_safe_at_the_abort_is_left_by_no_later_burn() -> None:
    burns, burn = decide(abort_burn.none(), planned=False)
    assert not burn
    for _ in range(20):
        burns, burn = decide(burns)
        assert not burn
    assert summary(burns) == (0, AbortBurnReason.NONE)


def test_before_an_abort_nothing_is_decided() -> None:
    no = jnp.asarray(False)
    allowed = permission(abort_burn.none(), no, ~no, ~no, ~no)
    assert not bool(allowed.of_abort | allowed.of_sight)
    found = recorded(abort_burn.none(), allowed, ~no, ~no)
    assert (*summary(found), bool(found.decided)) == (0, AbortBurnReason.NONE, False)


def test_the_decision_waits_for_a_thruster_that_has_failed() -> None:
    burns = abort_burn.none()
    for _ in range(5):
        burns, burn = decide(burns, works=False)
        assert not burn
    burns, burn = decide(burns)
    assert burn
    assert summary(burns) == (1, AbortBurnReason.ABORT)


def test_a_burn_that_was_not_made_is_made_again_once_the_thruster_works() -> None:
    burns, _ = decide(abort_burn.none())
    burns, burn = decide(burns, works=False, was_made=False)
    assert not burn
    # The plan of a decision without a burn counts as made.
    burns, burn = decide(burns, works=False)
    assert not burn
    burns, burn = decide(burns)
    assert burn
    assert summary(burns) == (2, AbortBurnReason.BURN_NOT_MADE)
    assert not decide(burns)[1]


def test_a_target_in_sight_may_be_a_reason_and_the_number_of_burns_is_limited() -> None:
    burns, _ = decide(abort_burn.none())
    for count in range(2, 10):
        burns, burn = decide(burns, sees=True)
        assert burn is (count <= MOST_BURNS)
    assert summary(burns) == (MOST_BURNS, AbortBurnReason.KEEP_OUT_SEEN)
    burns, burn = decide(burns, was_made=False)
    assert not burn


@pytest.mark.parametrize(
    ("given", "failed", "expected"),
    [(0.05, False, True), (0.02, False, False), (0.05, True, False), (0.0, False, False)],
)
def test_a_burn_is_made_if_the_valve_was_open_for_it_and_there_was_thrust(
    given: float, failed: bool, expected: bool
) -> None:
    size = np.array([0.03, 0.04, 0.0])
    yes, no = jnp.asarray(True), jnp.asarray(False)
    assert bool(abort_burn.is_made(jnp.asarray(size), jnp.asarray(given), yes, jnp.asarray(failed))) is expected
    # A burn of which a part is still to come.
    assert bool(abort_burn.is_made(jnp.asarray(size), jnp.asarray(given), no, jnp.asarray(failed)))
    # No burn, after one that has failed.
    assert bool(abort_burn.is_made(jnp.zeros(3), jnp.asarray(0.0), yes, jnp.asarray(failed)))
