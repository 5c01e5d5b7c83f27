"""The report page and report.json: template, the values that fill it, and what is written."""
