"""Kernels per tick of the closed loop compiled for an NVIDIA H100 by XLA alone: no device is needed.

python -m benchmarks.gpu_kernels [--batch N] [--set KEY=VALUE]...

JAX's CUDA plugin (`pip install jax[cuda12]`) must be installed; variables that are set already are not changed.
"""

import argparse
import json
import os
from unittest import mock

H100 = """
platform_name: "CUDA"
device_description_str: "NVIDIA H100 80GB HBM3"
runtime_version { major: 12 minor: 8 patch: 0 }
dnn_version_info { major: 9 minor: 7 }
gpu_device_info {
  cuda_compute_capability { major: 9 }
  core_count: 132
  fpus_per_core: 128
  threads_per_warp: 32
  threads_per_block_limit: 1024
  threads_per_core_limit: 2048
  shared_memory_per_block: 49152
  shared_memory_per_block_optin: 232448
  shared_memory_per_core: 233472
  registers_per_block_limit: 65536
  registers_per_core_limit: 65536
  block_dim_limit_x: 2147483647
  block_dim_limit_y: 65535
  block_dim_limit_z: 65535
  memory_bandwidth: 3352320000000
  l2_cache_size: 52428800
  clock_rate_ghz: 1.98
  device_memory_size: 84929347584
}
"""
"""Description of the device for XLA."""

_WITHOUT_DEVICE_FLAG = "--xla_gpu_autotune_level=0"
"""Measuring variants of a kernel would need the device."""


def main() -> None:
    """Prints the kernels and the memory of a run as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--batch", type=int, default=10_000)
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    options = parser.parse_args()
    os.environ.setdefault("JAX_PLATFORMS", "cpu,cuda")
    os.environ.setdefault("JAX_SKIP_CUDA_CONSTRAINTS_CHECK", "1")
    os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), _WITHOUT_DEVICE_FLAG]).strip()
    from jax.experimental import topologies

    from benchmarks.accelerator import loop_speed, memory
    from rpojax.benchmark import closed_loop_speed
    from rpojax.scenario.loading import scenario_loader

    (device,) = topologies.get_topology_desc(platform="cuda", target_config=H100, topology="1x1x1").devices
    file = scenario_loader.load("inspection", options.overrides)
    # This process computes on a CPU, but loops are unrolled and compiled as on a GPU.
    with mock.patch("jax.default_backend", return_value="gpu"):
        engine = closed_loop_speed.compile_engine(file, options.batch, [device])
    figures = loop_speed.kernel_figures(engine)
    per_run = memory.bytes_per_run(engine.loop_program, options.batch)
    print(json.dumps({**figures, "device_bytes_per_run": per_run, "loop_compile_s": engine.loop_compile_s}, indent=2))


if __name__ == "__main__":
    main()
