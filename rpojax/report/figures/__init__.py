"""Figures of campaigns and runs: charts of the page, the paper's figures, films."""
