"""Health of the equipment during faults of every kind."""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults
from rpojax.physics.equipment_faults import KINDS, Fault, Health, radio_works

START, DURATION = 100.0, 50.0

health = jax.jit(equipment_faults.health_at)

EFFECT = {
    "none": {},
    "wheel_stuck": {"wheel_stuck": [False, True, False]},
    "wheel_friction": {"wheel_friction": [0.0, 0.3, 0.0]},
    "thruster_off": {"thrust_fraction": 0.0},
    "thruster_weak": {"thrust_fraction": 0.7},
    "gps_outage": {"gps": False},
    "star_tracker_blind": {"star_tracker": False},
    "camera_blackout": {"camera": False},
    "radio_off": {},
    "thruster_stuck_open": {},
    "thruster_leak": {},
}
"""Change of the health by a fault of each kind, at a severity of 0.3 and on the second wheel."""


def fault(kind: float, wheel: float = 1.0) -> Fault:
    return Fault(
        kind=jnp.float64(kind),
        start=jnp.float64(START),
        duration=jnp.float64(DURATION),
        severity=jnp.float64(0.3),
        wheel=jnp.float64(wheel),
        thruster=jnp.float64(0.0),
    )


def assert_health(found: Health, changed: dict[str, object]) -> None:
    for field in fields(Health):
        expected = changed.get(field.name, getattr(equipment_faults.healthy(), field.name))
        np.testing.assert_array_equal(getattr(found, field.name), expected, err_msg=field.name)


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_affects_only_the_equipment_of_its_kind(kind: str) -> None:
    assert_health(health({"a": fault(KINDS.index(kind))}, jnp.float64(120.0)), EFFECT[kind])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("time", "active"), [(0.0, False), (99.9, False), (100.0, True), (149.9, True), (150.0, False), (1e6, False)]
)
def test_a_fault_lasts_from_its_start_to_just_before_its_end(kind: str, time: float, active: bool) -> None:
    assert_health(health({"a": fault(KINDS.index(kind))}, jnp.float64(time)), EFFECT[kind] if active else {})


@pytest.mark.parametrize("wheel", [0, 1, 2])
@pytest.mark.parametrize("kind", ["wheel_stuck", "wheel_friction"])
def test_a_wheel_fault_affects_the_wheel_of_its_index(kind: str, wheel: int) -> None:
    found = getattr(health({"a": fault(KINDS.index(kind), wheel)}, jnp.float64(120.0)), kind)
    assert [bool(x) for x in found] == [k == wheel for k in range(3)]


def test_the_code_of_a_kind_is_its_index_and_numbers_are_codes() -> None:
    assert [equipment_faults.kind_code(kind) for kind in KINDS] == list(range(len(KINDS)))
    assert equipment_faults.kind_code(3.0) == 3.0


def timed(kind: str, start: float, severity: float = 0.3, wheel: float = 1.0) -> Fault:
    return replace(
        fault(KINDS.index(kind), wheel), start=jnp.float64(start), severity=jnp.float64(severity), duration=jnp.inf
    )


def test_faults_at_once_multiply_thrust_add_friction_and_each_takes_its_own_equipment() -> None:
    both = {
        "a": timed("thruster_weak", 10.0, 0.5),
        "b": timed("thruster_weak", 20.0, 0.2),
        "c": timed("wheel_friction", 10.0, 0.3),
        "d": timed("wheel_friction", 20.0, 0.25),
        "e": timed("wheel_stuck", 20.0, wheel=2.0),
        "f": timed("gps_outage", 20.0),
    }
    first = {"thrust_fraction": 0.5, "wheel_friction": [0.0, 0.3, 0.0]}
    assert_health(health(both, jnp.float64(15.0)), first)
    second = {
        "thrust_fraction": 0.5 * 0.8,
        "wheel_friction": [0.0, 0.3 + 0.25, 0.0],
        "wheel_stuck": [False, False, True],
        "gps": False,
    }
    assert_health(health(both, jnp.float64(25.0)), second)


def test_without_a_fault_in_the_list_all_is_healthy() -> None:
    assert_health(health({}, jnp.float64(25.0)), {})
    assert bool(radio_works({}, jnp.float64(25.0)))
    assert np.array_equal(equipment_faults.rcs_fractions({}, jnp.float64(25.0), 3), np.ones(3))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("second", ["wheel_friction", "thruster_weak", "camera_blackout"])
def test_until_the_second_fault_starts_the_first_acts_as_alone_to_the_last_bit(kind: str, second: str) -> None:
    first = timed(kind, 100.1, 0.1)
    at_times = jax.jit(jax.vmap(equipment_faults.health_at, in_axes=(None, 0)))
    times = jnp.arange(0.0, 200.0, 0.2)
    alone, both = at_times({"a": first}, times), at_times({"a": first, "b": timed(second, 200.0, 0.7)}, times)
    jax.tree.map(np.testing.assert_array_equal, both, alone)
    later = at_times({"a": first, "b": timed(second, 150.0, 0.7)}, times)
    same = jax.tree.leaves(jax.tree.map(lambda one, other: bool(np.array_equal(one, other)), later, alone))
    # A camera that is black already is not blacker, nor is a thruster that is off weaker.
    assert all(same) == ((kind, second) in (("camera_blackout",) * 2, ("thruster_off", "thruster_weak")))


def test_thrust_and_friction_have_a_derivative_to_the_severity_alone() -> None:
    for kind, name, derivative in (
        ("thruster_weak", "thrust_fraction", -1.0),
        ("wheel_friction", "wheel_friction", 1.0),
    ):
        found = jax.grad(
            lambda f, name=name: jnp.sum(getattr(equipment_faults.health_at({"a": f}, jnp.float64(120.0)), name))
        )(fault(KINDS.index(kind)))
        assert float(found.severity) == derivative
        assert [float(getattr(found, other)) for other in ("kind", "start", "duration", "wheel")] == [0.0] * 4


@pytest.mark.parametrize("kind", KINDS)
def test_the_radio_fails_by_its_own_fault_alone(kind: str) -> None:
    one = {"a": fault(KINDS.index(kind))}
    works = [bool(radio_works(one, jnp.float64(time))) for time in (99.9, 100.0, 149.9, 150.0)]
    assert works == ([True, False, False, True] if kind == "radio_off" else [True] * 4)
