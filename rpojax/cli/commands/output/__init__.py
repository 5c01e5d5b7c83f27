"""Commands that turn results into reports, tables, recordings and films, or exchange messages while a run goes on."""
