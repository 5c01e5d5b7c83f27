"""Commands that simulate runs, and those about campaigns under way."""
