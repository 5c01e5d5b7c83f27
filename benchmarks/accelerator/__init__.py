"""Figures of one accelerator, measured in one sitting: `python -m benchmarks.accelerator`."""
