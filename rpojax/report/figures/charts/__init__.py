"""Interactive plotly charts of the report page."""
