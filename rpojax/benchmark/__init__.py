"""Speed of the closed loop, its kernels and the rendered camera on this machine, as `rpojax bench` measures it."""
