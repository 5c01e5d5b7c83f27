"""Settings that jax reads once: a host device per core, and nothing compiled taken from disk."""

from rpojax.runtime.jax_environment import prepare_jax, prepare_loop

prepare_jax(cache=False)
prepare_loop(rendered=False)
