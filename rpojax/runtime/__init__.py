"""Process-wide matters: environment of JAX, compiler options, garbage collector, devices, progress display."""
