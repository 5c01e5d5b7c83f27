"""Page on what changed between campaigns of the same runs: tables, overlays, and warnings where they differ in kind."""
