"""Process-wide matters: environment of JAX, compiler options, cached traces, devices, progress display."""
