"""Kernels per tick, counted in programs of which the kernels are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.benchmark import kernel_count
from rpojax.benchmark.kernel_count import ScopeKernels

TICK = """HloModule m, is_scheduled=true

%fused (p: f32[8]) -> f32[8] {
  %p = f32[8]{0} parameter(0)
  %n = f32[8]{0} negate(%p)
  ROOT %a = f32[8]{0} add(%p, %n)
}

%stage (s: (s32[], f32[8])) -> (s32[], f32[8]) {
  %s = (s32[], f32[8]{0}) parameter(0)
  %i = s32[] get-tuple-element(%s), index=0
  %x = f32[8]{0} get-tuple-element(%s), index=1
  %f = f32[8]{0} fusion(%x), kind=kLoop, calls=%fused, metadata={op_name="jit(g)/while/body/act/while/body/add"}
  %k = f32[8]{0} copy(%f)
  ROOT %t = (s32[], f32[8]{0}) tuple(%i, %k)
}

%less (s: (s32[], f32[8])) -> pred[] {
  %s = (s32[], f32[8]{0}) parameter(0)
  %i = s32[] get-tuple-element(%s), index=0
  %five = s32[] constant(5)
  ROOT %c = pred[] compare(%i, %five), direction=LT
}

%called (s: (s32[], f32[8])) -> (s32[], f32[8]) {
  %s = (s32[], f32[8]{0}) parameter(0)
  ROOT %l = (s32[], f32[8]{0}) while(%s), condition=%less, body=%stage, backend_config={"known_trip_count":{"n":"5"}}
}

%idle (x: f32[8]) -> f32[8] {
  ROOT %x = f32[8]{0} parameter(0)
}

%burn (x: f32[8]) -> f32[8] {
  %x = f32[8]{0} parameter(0)
  %b = f32[8]{0} fusion(%x), kind=kLoop, calls=%fused, metadata={op_name="jit(g)/while/body/plan_burn/cond/add"}
  ROOT %d = f32[8]{0} custom-call(%b), custom_call_target="solve", metadata={op_name="jit(g)/while/body/plan_burn/dot"}
}

%tick (t: (s32[], f32[8])) -> (s32[], f32[8]) {
  %t = (s32[], f32[8]{0}) parameter(0)
  %g = (s32[], f32[8]{0}) CALL
  %i = s32[] get-tuple-element(%g), index=0
  %x = f32[8]{0} get-tuple-element(%g), index=1
  %y = f32[8]{0} conditional(%i, %x, %x), branch_computations={%idle, %burn}
  %v = ((f32[8]{0}), f32[8]{0}) copy-start(%y), metadata={op_name="jit(g)/while/body/sense/copy"}
  %z = f32[8]{0} copy-done(%v)
  ROOT %r = (s32[], f32[8]{0}) tuple(%i, %z)
}

ENTRY %main (t: (s32[], f32[8])) -> (s32[], f32[8]) {
  %t = (s32[], f32[8]{0}) parameter(0)
  %h = (s32[], f32[8]{0}) copy(%t)
  ROOT %w = (s32[], f32[8]{0}) while(%h), condition=%less, body=%tick, backend_config={"known_trip_count":{"n":"200"}}
}
"""
"""A tick of five passes of a fusion and a copy, a branch with a fusion and a library call or nothing, and a copy."""

FUNCTION = TICK.replace("CALL", 'call(%t), to_apply=%called, frontend_attributes={xla_cpu_small_call="true"}')


IN_LOOP_OF_UNKNOWN_LENGTH = (
    TICK.replace("ENTRY %main", "%part").replace("%w = ", "%l = ")
    + """
ENTRY %main (t: (s32[], f32[8])) -> (s32[], f32[8]) {
  %t = (s32[], f32[8]{0}) parameter(0)
  ROOT %w = (s32[], f32[8]{0}) while(%t), condition=%less, body=%part
}
"""
)


def test_loops_count_by_their_passes_and_branches_by_their_extremes() -> None:
    found = kernel_count.kernels_per_tick(TICK.replace("CALL", "call(%t), to_apply=%called"))
    assert (found.fewest, found.most, found.decisions) == (5 * 2 + 0 + 1, 5 * 2 + 2 + 1, 1)
    assert {(each.scope, each.passes): each.kernels for each in found.contributions} == {
        ("act", 5): 1,
        ("copies", 5): 1,
        ("plan_burn", 1): 2,
        ("sense", 1): 1,
    }
    per_tick = [each.per_tick for each in found.contributions]
    assert per_tick == sorted(per_tick, reverse=True)
    assert sum(per_tick) == found.most


def test_the_loop_over_ticks_may_be_in_one_of_unknown_length() -> None:
    text = IN_LOOP_OF_UNKNOWN_LENGTH.replace("CALL", "call(%t), to_apply=%called")
    assert kernel_count.kernels_per_tick(text) == kernel_count.kernels_per_tick(
        TICK.replace("CALL", "call(%t), to_apply=%called")
    )


def test_a_loop_that_a_cpu_runs_as_one_function_is_one_kernel() -> None:
    closed, opened = (kernel_count.kernels_per_tick(FUNCTION, open_functions=each) for each in (False, True))
    assert (closed.most, opened.most) == (1 + 2 + 1, 5 * 2 + 2 + 1)


def test_a_loop_of_unknown_length_counts_once_and_the_host_decides_its_end() -> None:
    text = TICK.replace("CALL", "call(%t), to_apply=%called").replace('{"known_trip_count":{"n":"5"}}', "{}")
    found = kernel_count.kernels_per_tick(text)
    assert (found.most, found.decisions) == (2 + 2 + 1, 2)


def test_a_program_without_loop_is_counted_as_a_whole() -> None:
    text = jax.jit(lambda x: jnp.sin(x) + 1.0).lower(np.ones(64)).compile().as_text()
    assert text is not None
    assert kernel_count.kernels_per_tick(text).contributions == [ScopeKernels("other", 1, 1)]


@pytest.mark.parametrize("stages", [1, 3])
def test_kernels_of_a_compiled_scan_are_those_that_cannot_be_fused(stages: int) -> None:
    """Each sort is a kernel of its own, with one fusion before it; its counter and copies are others."""

    def tick(x: jax.Array, _: None) -> tuple[jax.Array, None]:
        with jax.named_scope("navigate"):
            for _ in range(stages):
                x = jnp.sort(jnp.cos(x) * 2.0)
        return x, None

    text = jax.jit(lambda x: jax.lax.scan(tick, x, None, length=50)[0]).lower(np.ones(64)).compile().as_text()
    assert text is not None
    found = kernel_count.kernels_per_tick(text)
    navigate = [each for each in found.contributions if each.scope == "navigate"]
    assert [(each.passes, each.kernels) for each in navigate] == [(1, 2 * stages)]
    assert found.fewest == found.most
    assert found.decisions == 0
