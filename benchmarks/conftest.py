"""Settings that jax reads once: one host device per core, and no compilation cache."""

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)
