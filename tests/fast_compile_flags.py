"""Flags with which XLA compiles sooner what then runs for a second: with less effort, and by its older fused loops."""

import jax

FLAGS = ["--xla_backend_optimization_level=0"]
# Names of these flags are not promised, and XLA stops at one it does not know. The second keeps what is compiled in one
# part: the workers of a session have a core each.
if jax.__version_info__[:2] == (0, 10):
    FLAGS += ["--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1"]
