"""Commands that simulate runs, those about campaigns under way, and the speed of this machine."""
