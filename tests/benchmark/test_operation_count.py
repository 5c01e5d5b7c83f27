"""Bounds on the operations of the compiled closed loop, which do not depend on the load of the machine."""

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
from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import initial_state
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.noise import run_key
from rpojax.simulation.step import step

RUNS = 64
"""Batch size on one device; larger batches have the same operations per run."""

MAX_FLOPS_PER_RUN = 29_000.0
"""Floating-point operations per tick and run from `cost_analysis`, which counts the bodies of inner loops once.

A fifth above some 24,000 that this test counts (JAX 0.10.2 on a CPU).
"""

MAX_INSTRUCTIONS = 1140
"""Instructions of the optimised program, fusions counted once; each is started at least once per tick.

A fifth above the 951 that this test counts (JAX 0.10.2 on a CPU).
"""

MAX_MULTIPLICATIONS = 2960
"""A fifth above the 2468 of the compiled loop; recomputation across stages takes several times as many."""

COUNT = """
import json, sys
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)
import jax
import rpojax
from rpojax.benchmark import operation_count
from rpojax.campaign.execution.batch_engine import BatchEngine

runs = int(sys.argv[1])
engine = BatchEngine(rpojax.load("inspection"), runs, jax.devices()[:1])
engine.compile()
loop = engine.loop_program
text = loop.as_text()
counts = len(operation_count.instructions(text)), text.count(" multiply(")
print(json.dumps([loop.cost_analysis()["flops"] / runs, *counts]))
"""
"""Compiles the loop as the commands do, with flags that apply to a whole process."""


@pytest.fixture(scope="module")
def counted() -> tuple[float, int, int]:
    """Floating-point operations of a run and tick, instructions and multiplications of the compiled closed loop."""
    # The counts do not depend on the optimisation by LLVM, which these flags reduce.
    environment = {**os.environ, "XLA_FLAGS": fast_compile_flags.FLAGS[0]}
    environment["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    words = [sys.executable, "-c", COUNT, str(RUNS)]
    done = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
    flops, instructions, multiplications = json.loads(done.stdout.splitlines()[-1])
    return flops, instructions, multiplications


@pytest.mark.slow
def test_floating_point_operations_per_tick_are_bounded(counted: tuple[float, int, int]) -> None:
    assert 0.0 < counted[0] < MAX_FLOPS_PER_RUN


@pytest.mark.slow
def test_instructions_per_tick_are_bounded(counted: tuple[float, int, int]) -> None:
    assert 0 < counted[1] < MAX_INSTRUCTIONS


@pytest.mark.slow
def test_multiplications_of_the_loop_are_bounded(counted: tuple[float, int, int]) -> None:
    assert 0 < counted[2] < MAX_MULTIPLICATIONS


def test_every_scope_occurs_in_the_tick(inspection: Scenario, inspection_params: Params) -> None:
    def first_tick(params: Params) -> tuple[Channels, jax.Array]:
        state = initial_state.init(inspection, params, run_key(0, 0))
        after, seen = step(inspection, params, state, Stages())
        return compute_channels(inspection, params, seen), after.tick

    traced = jax.make_jaxpr(first_tick)(inspection_params)
    names = {part for equation in traced.eqns for part in str(equation.source_info.name_stack).split("/")}
    assert set(SCOPES) <= names


def test_parts_of_fusions_and_instructions_without_work_are_left_out() -> None:
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
