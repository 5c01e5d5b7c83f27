"""Two-line elements of a station in low Earth orbit, made up."""

LINES = (
    "1 25544U 98067A   26079.61527778  .00016717  00000-0  10270-3 0  9005",
    "2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560000    17",
)


def with_checksum(line: str) -> str:
    """An element line with its last digit made right."""
    return line[:68] + str(sum(int(c) if c.isdecimal() else c == "-" for c in line[:68]) % 10)


TLE = "\n".join(map(with_checksum, LINES)) + "\n"
