"""Teams of servicers in the report: where they move, who sees what, links, consistency and separation."""
