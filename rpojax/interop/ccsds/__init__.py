"""Messages of the CCSDS: ephemerides and attitudes of both spacecraft of a run, and their state at its start."""
