"""Frame ids of the ROS 2 messages.

| frame id | letter | what |
|---|---|---|
| `eci` | N | inertial, origin in Earth's centre, Earth's pole = +z |
| `hill` | H | Hill frame (RTN) of the target, origin in the target: x radial outward, y along-track, z orbit normal |
| `servicer/base_link` | B | servicer body, origin in its centre of mass |
| `target/base_link` | T | target body, origin in its centre of mass |
| `servicer/camera_optical_frame` | K | camera: x right, y down, z along the boresight (REP 103) |
"""

ECI = "eci"
HILL = "hill"
SERVICER = "servicer/base_link"
TARGET = "target/base_link"
CAMERA = "servicer/camera_optical_frame"
