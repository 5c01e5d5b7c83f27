"""The report pages and report.json: templates, the values that fill them, and what is written."""
