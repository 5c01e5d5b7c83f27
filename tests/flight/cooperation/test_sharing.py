"""What sharing makes of an estimate that guidance has reopened after a failed search."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cooperative_scene import Case, link_of, servicers_tuning, settings, start

from rpojax.core.pytree import replace
from rpojax.flight.cooperation import sharing
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_settings import BaselineTuning
from rpojax.scenario.params import Params

SERVICERS = 2
BASELINE = BaselineTuning(
    noise=jnp.asarray(0.05),
    error_sigma=jnp.asarray(0.007),
    error_time_constant=jnp.asarray(700.0),
    range_noise=jnp.asarray(0.1),
    range_bias_sigma=jnp.asarray(0.05),
)


@partial(jax.jit, static_argnums=0)
def after_a_tick(method: str, params: Params, inflation: jax.Array, reopened: jax.Array) -> SharingMemory:
    """Memory a tick after the hand-over, with the covariances of the filters multiplied by a factor before."""
    case, tuning = Case(settings(SERVICERS, method)), params.flight.navigation
    world = start(case, tuning, BASELINE, jax.random.key(0))
    relative = world.orbit.relative
    before = replace(world.orbit, relative=replace(relative, covariance=inflation * relative.covariance))
    place = before.servicer.r_SN_N
    motion = TickMotion(
        r_before_N=place,
        r_after_N=place,
        delta_v_N=jnp.zeros((3, SERVICERS)),
        burn_covariance=jnp.zeros((3, 3, SERVICERS)),
        reopened=reopened,
    )
    link = link_of(case, BASELINE)
    return sharing.predict(link, servicers_tuning(tuning, SERVICERS), world.memory, before.relative, motion)


def position_variances(memory: SharingMemory) -> np.ndarray:
    """Variances (3, N) of the target's position by what a servicer filters itself [m^2]."""
    if memory.joint is not None:
        return np.einsum("iin->in", memory.joint.covariance.xx[:3, :3])
    assert memory.estimates is not None
    assert memory.estimates.local is not None
    return np.einsum("iin->in", memory.estimates.local.covariance[:3, :3])


@pytest.mark.parametrize("method", ["boxes", "estimates"])
def test_the_flag_alone_and_no_other_inflation_reopens_what_a_servicer_filters(method: str, params: Params) -> None:
    never, second = jnp.array([False, False]), jnp.array([False, True])
    plain = position_variances(after_a_tick(method, params, jnp.float64(1.0), never))
    inflated = position_variances(after_a_tick(method, params, jnp.float64(4.0), never))
    np.testing.assert_array_equal(inflated, plain)
    reopened = position_variances(after_a_tick(method, params, jnp.float64(1.0), second))
    np.testing.assert_array_equal(reopened[:, 0], plain[:, 0])
    np.testing.assert_allclose(reopened[:, 1] / plain[:, 1], 2.0, rtol=1e-6)
