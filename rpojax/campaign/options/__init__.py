"""Options of a campaign, free of jax and numpy: which runs, which histories are kept, which blocks a job simulates."""
