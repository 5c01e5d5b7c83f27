"""Figures of campaigns and runs: the page's charts, the paper's figures, linear covariance, camera films."""
