"""Charts of the report page as figures in plotly's format, which the page draws itself."""
