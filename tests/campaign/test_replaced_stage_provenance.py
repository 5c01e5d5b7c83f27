"""Records of replaced stages."""

import jax

from rpojax.campaign.replaced_stage_provenance import replaced_stages
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
