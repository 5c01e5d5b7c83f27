"""Floor 5: one closed-loop run: state, noise, step, rollout, telemetry, metrics."""
