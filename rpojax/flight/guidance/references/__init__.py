"""Reference trajectories: the desired relative state of a phase, one kind a module, and the burns that follow them."""
