"""How much the compiled closed loop does: bounds on what XLA counts in it, which no busy machine can change."""

import json
import os
import subprocess
import sys
from pathlib import Path

import fast_compile_flags
import jax
import pytest

import rpojax
from rpojax.benchmark import operation_count
from rpojax.benchmark.operation_count import COPIES, OTHER, SCOPES, Instruction
from rpojax.flight.computer import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import closed_loop, telemetry

RUNS = 64
"""On one device; larger batches do the same operations for each run."""

MOST_FLOPS_PER_RUN = 29_000.0
"""Floating-point operations of a tick and run as `cost_analysis` counts them, the bodies of inner loops once.

A fifth above the 24,149 that this test counts (JAX 0.10.2 on a CPU).
"""

MOST_INSTRUCTIONS = 940
"""Instructions of the optimised program, a fused one being one: each of them is started once a tick or more often.

A fifth above the 779 that this test counts (JAX 0.10.2 on a CPU).
"""

MOST_MULTIPLICATIONS = 2520
"""A fifth above the 2091 of the compiled loop; recomputing across stage borders takes several times as many."""

COUNT = """
import json, sys
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)
import jax
import rpojax
from rpojax.benchmark import closed_loop_speed, operation_count
from rpojax.campaign.execution.batch_engine import BatchEngine

runs = int(sys.argv[1])
engine = BatchEngine(rpojax.load("inspection"), runs, jax.devices()[:1])
engine.compile()
loop = closed_loop_speed.loop_program(engine)
text = loop.as_text()
counts = len(operation_count.instructions(text)), text.count(" multiply(")
print(json.dumps([loop.cost_analysis()["flops"] / runs, *counts]))
"""
"""Compiles the loop as the verbs do, with flags that hold for a whole process."""


@pytest.fixture(scope="module")
def counted() -> tuple[float, int, int]:
    """Floating-point operations of a run and tick, instructions and multiplications of the compiled closed loop."""
    # What is counted is settled before LLVM begins.
    environment = {**os.environ, "XLA_FLAGS": fast_compile_flags.FLAGS[0]}
    environment["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    words = [sys.executable, "-c", COUNT, str(RUNS)]
    done = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
    flops, instructions, multiplications = json.loads(done.stdout.splitlines()[-1])
    return flops, instructions, multiplications


def test_a_tick_takes_no_more_operations_than_it_needs(counted: tuple[float, int, int]) -> None:
    assert 0.0 < counted[0] < MOST_FLOPS_PER_RUN


def test_a_tick_takes_no_more_instructions_than_it_needs(counted: tuple[float, int, int]) -> None:
    assert 0 < counted[1] < MOST_INSTRUCTIONS


def test_the_compiled_loop_does_not_recompute(counted: tuple[float, int, int]) -> None:
    assert 0 < counted[2] < MOST_MULTIPLICATIONS


def test_every_scope_is_one_of_the_tick(inspection: Scenario, inspection_params: Params) -> None:
    def first(params: Params) -> tuple[telemetry.Channels, jax.Array]:
        state = closed_loop.init(inspection, params, closed_loop.run_key(0, 0))
        after, seen = closed_loop.tick(Stages(), inspection, params, state)
        return telemetry.compute_channels(inspection, params, seen), after.tick

    traced = jax.make_jaxpr(first)(inspection_params)
    names = {part for equation in traced.eqns for part in str(equation.source_info.name_stack).split("/")}
    assert set(SCOPES) <= names


def test_instructions_are_those_that_are_carried_out_by_themselves() -> None:
    text = """HloModule m, entry_computation_layout={(f64[2]{0})->f64[]}

%fused_computation.1 (p: f64[2]) -> f64[2] {
  %p = f64[2]{0} parameter(0)
  ROOT %a = f64[2]{0} add(%p, %p)
}

%sum (a: f64[], b: f64[]) -> f64[] {
  %a = f64[] parameter(0)
  %b = f64[] parameter(1)
  ROOT %c = f64[] add(%a, %b)
}

%body (t: (s64[], f64[2])) -> (s64[], f64[2]) {
  %t = (s64[], f64[2]{0}) parameter(0)
  %n = s64[] get-tuple-element(%t), index=0
  %x = f64[2]{0} get-tuple-element(%t), index=1
  %f = f64[2]{0} fusion(%x), calls=%fused_computation.1, metadata={op_name="jit(g)/while/body/vmap(act)/add"}
  ROOT %u = (s64[], f64[2]{0}) tuple(%n, %f)
}

ENTRY %main (x: f64[2]) -> f64[] {
  %x = f64[2]{0} parameter(0)
  %w = (s64[], /*index=1*/f64[2]{0}) while(%x), condition=%less, body=%body, metadata={op_name="jit(g)/while"}
  %y = f64[2]{0} get-tuple-element(%w), index=1
  %k = f64[2]{0} copy(%y)
  ROOT %r = f64[] reduce(%k, %x), dimensions={0}, to_apply=%sum, metadata={op_name="jit(g)/guide/sense/navigated"}
}
"""
    found = operation_count.instructions(text)
    assert found == [
        Instruction("f", "fusion", "act"),
        Instruction("w", "while", OTHER),
        Instruction("k", "copy", COPIES),
        Instruction("r", "reduce", "sense"),
    ]
    assert [each.contains_instructions for each in found] == [False, True, False, False]
