"""Settings that jax reads once: a host device per core, and nothing compiled taken from disk."""

from rpojax.machine import prepare_jax, prepare_loop

prepare_jax(cache=False)
prepare_loop(rendered=False)
