"""The report page: template, records that fill it, report.json."""
