"""Floor 5: closed-loop simulation of one run, as pure functions: state, noise, step, rollout, telemetry, metrics."""
