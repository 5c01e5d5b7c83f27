"""Flags with which XLA compiles sooner what then runs for a second: with less effort, and by its older fused loops."""

import jax

FLAGS = ["--xla_backend_optimization_level=0"]
# The name of this flag is not promised, and XLA stops at one it does not know.
FLAGS += ["--xla_cpu_use_fusion_emitters=false"] if jax.__version_info__[:2] == (0, 10) else []
