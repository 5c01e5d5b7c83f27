"""Settings that jax reads once: a host device per core, and nothing compiled taken from disk."""

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

prepare_jax(cache=False)
set_loop_fusion_flag(rendered=False)
