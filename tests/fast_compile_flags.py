"""XLA flags for short compilation, since test programs run for a second: no optimisation, older fusion emitters."""

import jax

FLAGS = ["--xla_backend_optimization_level=0"]
# XLA aborts at unknown flags, and may rename these. The second compiles on one core: each worker of a session has one.
if jax.__version_info__[:2] == (0, 10):
    FLAGS += ["--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1"]
