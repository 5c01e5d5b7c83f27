"""Sections of the report, one module each: their part of report.json, and the rows and charts that the page shows."""
