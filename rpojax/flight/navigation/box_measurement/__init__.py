"""Bounding boxes as measurements of the target: their model, the gate for outliers, and rows for a Kalman update."""
