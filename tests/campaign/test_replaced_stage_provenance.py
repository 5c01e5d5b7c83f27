"""Records of replaced stages."""

import json
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import pytest

from rpojax.campaign.storage.provenance import check_same_stages, replaced_stages
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages


def test_functions_lambdas_and_objects_have_a_name_and_a_source_if_known() -> None:
    class Law:
        def __call__(self, gain: jax.Array, deviation: jax.Array) -> jax.Array:
            return -deviation[3:]

    records = replaced_stages(Stages(formation_law=Law(), wheel_torque=eval("lambda **_: 0.0")))
    assert set(records) == {"formation_law", "wheel_torque"}
    assert str(records["formation_law"]["function"]).endswith("<locals>.Law")
    assert records["formation_law"]["source_sha256"]
    assert records["wheel_torque"]["source_sha256"] is None


def scaled(scale: float, deviation: jax.Array) -> jax.Array:
    """A law with a gain of its own."""
    return -scale * deviation[3:]


def closure(scale: float) -> Callable[..., jax.Array]:
    """The same law, which captures its gain."""
    return lambda deviation: -scale * deviation[3:]


class Scaled:
    """The same law as an object."""

    def __init__(self, scale: float) -> None:
        self.scale = scale

    def __call__(self, deviation: jax.Array) -> jax.Array:
        return -self.scale * deviation[3:]


@pytest.mark.parametrize(
    "make",
    [
        lambda scale: partial(scaled, scale),
        lambda scale: partial(scaled, scale=scale),
        closure,
        Scaled,
        lambda scale: jax.jit(closure(scale)),
        lambda scale: closure(jnp.full(3, scale)),
    ],
)
def test_functions_that_hold_other_values_are_other_functions(make: Callable[[float], Any]) -> None:
    recorded = json.loads(json.dumps(replaced_stages(Stages(formation_law=make(1.0)))))
    check_same_stages(recorded, Stages(formation_law=make(1.0)))
    with pytest.raises(RpojaxError, match=r"^stages: found [^\n]*$"):
        check_same_stages(recorded, Stages(formation_law=make(2.0)))


def test_other_lambdas_on_one_line_are_other_functions() -> None:
    one, other = (lambda deviation: -deviation[3:], lambda deviation: -2.0 * deviation[3:])
    with pytest.raises(RpojaxError, match="stages: found"):
        check_same_stages(replaced_stages(Stages(formation_law=one)), Stages(formation_law=other))


def test_values_without_content_are_never_the_same() -> None:
    law = closure(cast(float, iter([1.0])))
    with pytest.raises(RpojaxError, match="stages: found"):
        check_same_stages(replaced_stages(Stages(formation_law=law)), Stages(formation_law=law))


def test_a_record_of_an_earlier_version_is_compared_by_name_and_source() -> None:
    recorded = replaced_stages(Stages(formation_law=closure(1.0)))
    with pytest.raises(RpojaxError, match="stages: found"):
        check_same_stages(recorded, Stages(formation_law=closure(2.0)))
    del recorded["formation_law"]["values_sha256"]
    check_same_stages(recorded, Stages(formation_law=closure(2.0)))
    with pytest.raises(RpojaxError, match="stages: found"):
        check_same_stages(recorded, Stages(formation_law=Scaled(1.0)))
