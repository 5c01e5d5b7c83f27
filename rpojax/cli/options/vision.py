"""Options of the commands for radiance fields, the detector and the camera model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rpojax.cli.options.arguments import FLAT, AllowPlugin, AsJson, Command, Overrides, Source
from rpojax.errors import RpojaxError

NetworkSeed = Annotated[int, arg(metavar="S", help="Seed.")]
ViewSeed = Annotated[int, arg(metavar="S", help="Seed of views and training.")]
ForceAny = Annotated[bool, arg(help="Replace what is there.")]
DataFolder = Annotated[
    Positional[Path], arg(metavar="DATASET", help="Folder with annotations.json in COCO's format, or with several.")
]
DataFolders = Annotated[
    Positional[tuple[Path, ...]],
    arg(metavar="DATASET...", help="Folders, each with annotations.json in COCO's format or with several."),
]
Weights = Annotated[Path | None, arg(metavar="FILE", help="Weights; the packaged ones by default.")]
Mesh = Annotated[str, arg(metavar="MESH", help="Mesh file (glb, obj, ply, stl), or 'target' for the packaged one.")]
Given = Annotated[Positional[Path | None], arg(metavar="FIELD", help="Field; that of the packaged target by default.")]


@dataclass(frozen=True)
class MeshPlacement:
    """Scale and place of a mesh."""

    units: Annotated[str | None, arg(metavar="UNIT", help="Units of the mesh: m, cm, mm, in, ft.")] = None
    center: Annotated[bool, arg(help="Move the middle of the mesh to the origin.")] = False


@dataclass(frozen=True)
class FreshViews:
    """Views that a field is compared in, ray-traced for that.

    Raises:
        RpojaxError: a number is out of range.
    """

    views: Annotated[int, arg(metavar="N", help="Fresh ray-traced views, each with a Sun of its own.")] = 64
    samples: Annotated[int, arg(metavar="N", help="Samples per pixel of the ray tracer.")] = 256
    range_m: Annotated[float | None, arg(metavar="R", help="Range [m]; default: the target fills 60 % of it.")] = None
    fov_deg: Annotated[float, arg(metavar="A", help="Field of view [deg].")] = 26.0
    seed: ViewSeed = 0

    def __post_init__(self) -> None:
        if self.views < 1 or self.samples < 1:
            raise RpojaxError.of_argument("views, samples", f"found {self.views}, {self.samples}, expected at least 1")
        check_seed(self.seed)
        if not 0.0 < self.fov_deg < 170.0:
            raise RpojaxError.of_argument("fov_deg", f"found {self.fov_deg}, expected more than 0 and less than 170")


def check_seed(seed: int) -> None:
    """Refuses a seed that random numbers cannot be made from."""
    if not 0 <= seed < 2**31:
        raise RpojaxError.of_argument("seed", f"found {seed}, expected 0 to 2147483647")


@dataclass(frozen=True, kw_only=True)
class DetectCommand(Command):
    """Find spacecraft in pictures of any size; boxes are in pixels of the upright picture, x and y at the upper left.

    A picture that cannot be used is named on stderr and the rest are searched; the exit status is then 3, or 2 if none
    could be used.
    """

    work = "vision.detect:detect"
    prepares_jax = False

    images: Annotated[Positional[tuple[Path, ...]], arg(metavar="IMAGE", help="JPEG or PNG pictures.")]
    weights: Weights = None
    threshold: Annotated[float, arg(metavar="P", help="Least score of a box.")] = 0.5
    drawn: Annotated[Path | None, arg(metavar="DIR", help="Write the pictures with their boxes here, as PNG.")] = None
    force: Annotated[bool, arg(help="Replace pictures that are there.")] = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class CalibrateCameraModelCommand(Command):
    """Fit the statistical camera to renderer and detector, for the camera and target of a scenario."""

    work = "vision.calibrate_camera_model:calibrate_camera_model"
    prepares_jax = False

    scenario: Source
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as target.camera.safetensors.")]
    samples: Annotated[int, arg(metavar="N", help="Rendered views for the fit.")] = 16000
    sequences: Annotated[
        int, arg(metavar="N", help="Sequences of tumbling targets for the correlation time of errors.")
    ] = 200
    range_m: Annotated[
        tuple[float, float] | None,
        arg(
            metavar="LOW HIGH",
            help="Least and largest range [m], evenly in their logarithm; by default 0.6 and 1.5 times those of start, "
            "station and phases.",
        ),
    ] = None
    seed: Annotated[int, arg(metavar="S", help="Seed of the views and of the fit.")] = 0
    overrides: Overrides = ()
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class TrainFieldCommand(Command):
    """Ray-trace views of a mesh and train a field on them; an interrupted call continues."""

    work = "vision.field:train"
    prepares_jax = False

    mesh: Positional[Mesh]
    placement: Annotated[MeshPlacement, FLAT]
    out: Annotated[Path, arg(metavar="FIELD", help="File to write, such as target.field.safetensors.")]
    views: Annotated[int, arg(metavar="N", help="Ray-traced views.")] = 300
    steps: Annotated[int, arg(metavar="N", help="Training steps at most.")] = 2000
    minutes: Annotated[float | None, arg(metavar="T", help="Time limit of the training [min].")] = None
    seed: ViewSeed = 0
    kind: Annotated[str, arg(metavar="KIND", help="'grid', or 'point' for the slow reference network.")] = "grid"
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class EvaluateFieldCommand(Command):
    """Compare a field's pictures with fresh ray traces of its mesh."""

    work = "vision.field:evaluate"
    prepares_jax = False

    placement: Annotated[MeshPlacement, FLAT]
    fresh: Annotated[FreshViews, FLAT]
    field: Given = None
    mesh: Annotated[str | None, arg(metavar="MESH", help="Mesh that FIELD was trained on.")] = None
    glints: Annotated[bool, arg(help="Views in which a face mirrors the Sun, within 3 deg, into the camera.")] = False
    sheet: Annotated[Path | None, arg(metavar="PNG", help="Write ray traces, renderings and differences.")] = None
    force: Annotated[bool, arg(help="Replace the sheet if it is there.")] = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class RenderFieldCommand(Command):
    """Pictures of a field: a still, a contact sheet, or a turntable."""

    work = "vision.field:render"
    prepares_jax = False

    field: Given = None
    out: Annotated[Path, arg(metavar="FILE", help="Picture (.png) or turntable (.mp4) to write.")]
    frames: Annotated[int, arg(metavar="N", help="Views: one is a still, more a contact sheet or a turntable.")] = 1
    size_px: Annotated[int, arg(metavar="P", help="Width and height of a view.")] = 256
    sun: Annotated[tuple[float, float, float], arg(metavar="X Y Z", help="Direction of the Sun in target axes.")] = (
        1.0,
        0.6,
        0.8,
    )
    elevation_deg: Annotated[float, arg(metavar="A", help="Height of the camera above the x-y plane.")] = 25.0
    azimuth_deg: Annotated[float, arg(metavar="A", help="Direction of the first view, from x towards y.")] = 60.0
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class MakeDataCommand(Command):
    """Make pictures of ray-traced spacecraft with boxes; an interrupted call continues."""

    work = "vision.detector:data"
    prepares_jax = False

    out: Annotated[Path, arg(metavar="DIR", help="Folder to make, with the folders training and validation.")]
    count: Annotated[int, arg(metavar="N", help="Pictures to train on.")] = 2000
    validation: Annotated[
        int, arg(metavar="N", help="Pictures for validation, of other spacecraft and the packaged target.")
    ] = 500
    craft: Annotated[int, arg(metavar="N", help="Spacecraft beside the packaged target.")] = 72
    views: Annotated[int, arg(metavar="N", help="Ray-traced views of each.")] = 14
    generator: Annotated[
        Literal["1", "2", "1-empty", "2-empty"],
        arg(metavar="NAME", help="What pictures show: 2, 1 as for the first packaged weights, or no spacecraft."),
    ] = "2"
    seed: NetworkSeed = 0
    preview: Annotated[Path | None, arg(metavar="PNG", help="Write the first pictures with their boxes.")] = None
    force: ForceAny = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class TrainDetectorCommand(Command):
    """Train the detector on pictures with boxes; an interrupted call continues."""

    work = "vision.detector:train"

    datasets: DataFolders
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as detector.safetensors.")]
    epochs: Annotated[int, arg(metavar="N", help="Passes over the data for the proposal network.")] = 100
    second_epochs: Annotated[int, arg(metavar="N", help="Passes over the data for the refinement network.")] = 30
    minutes: Annotated[
        float | None, arg(metavar="T", help="Time limit of the training [min]; the schedule adapts.")
    ] = None
    start: Annotated[
        Path | None, arg(metavar="FILE", help="Initial weights where layers agree, instead of random ones.")
    ] = None
    rate: Annotated[float, arg(metavar="R", help="Peak learning rate.")] = 5e-3
    seed: NetworkSeed = 0
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class RefineDetectorCommand(Command):
    """Refine detector and filter noises together by the navigation error of runs, and judge them on unseen ones.

    What is no better beyond chance, or has forgotten more than 0.01 of average precision, is not kept: the file then
    has the weights of the scenario. Refined noises stand in a scenario beside it (.toml), all figures in a .json.
    """

    work = "vision.refine_detector:refine"

    scenario: Source
    out: Annotated[Path, arg(metavar="FILE", help="Weights to write, such as detector.safetensors.")]
    data: Annotated[
        tuple[Path, ...], arg(metavar="DATASET...", help="Folders of `detector data`, which tell what was forgotten.")
    ]
    runs: Annotated[int, arg(metavar="N", help="Runs in each step.")] = 8
    steps: Annotated[int, arg(metavar="N", help="Steps of the descent.")] = 20
    horizon_s: Annotated[float, arg(metavar="T", help="Simulated time of these runs [s].")] = 120.0
    temperature: Annotated[float, arg(metavar="T", help="Of the soft detector, in log-odds.")] = 0.25
    rate: Annotated[float, arg(metavar="R", help="Size of the first steps, in logarithms of the noises.")] = 0.05
    validation_runs: Annotated[int, arg(metavar="N", help="Unseen runs.")] = 32
    validation_s: Annotated[
        float | None, arg(metavar="T", help="Simulated time of these [s]; by default that of the scenario.")
    ] = None
    seed: Annotated[int, arg(metavar="S", help="Seed of the runs; that of the unseen ones is the next.")] = 0
    overrides: Overrides = ()
    force: ForceAny = False
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class EvaluateDetectorCommand(Command):
    """Evaluate a detector on pictures with boxes: average precision, accuracy of boxes, false alarms."""

    work = "vision.detector:evaluate"
    prepares_jax = False

    dataset: DataFolder
    weights: Weights = None
    form: Annotated[
        Literal["coco", "speed", "spark", "yolo"],
        arg(name="format", metavar="FORMAT", help="coco, speed (SPEED+ and SHIRT too), spark or yolo."),
    ] = "coco"
    labels: Annotated[
        Path | None, arg(metavar="FILE", help="Labels of speed, spark or yolo; by default those not for training.")
    ] = None
    limit: Annotated[int | None, arg(metavar="N", help="Most pictures of speed, spark or yolo, chosen evenly.")] = None
    as_json: AsJson = False


@dataclass(frozen=True)
class PortOptions:
    """Docking port of a target, and the view in which landmarks count as those on its face."""

    port_position: Annotated[
        tuple[float, float, float] | None, arg(metavar="X Y Z", help="Docking port in target axes [m].")
    ] = None
    port_axis: Annotated[
        tuple[float, float, float] | None, arg(metavar="X Y Z", help="Direction out of the port in target axes.")
    ] = None
    port_range: Annotated[float, arg(metavar="R", help="Range of the last view along that axis [m].")] = 1.5
    port_fov_deg: Annotated[
        float, arg(metavar="A", help="Field of view then [deg]; default: the wide lens of final_approach.")
    ] = 45.0
    port_landmarks: Annotated[int, arg(metavar="N", help="Landmarks that have to be in that view.")] = 8

    def __post_init__(self) -> None:
        if (self.port_position is None) != (self.port_axis is None):
            raise RpojaxError.of_argument("port_position, port_axis", "found one of them, expected both or none")
        if not 0.0 < self.port_fov_deg < 170.0 or not 0.0 < self.port_range < 1e4:
            found = f"{self.port_fov_deg}, {self.port_range}"
            raise RpojaxError.of_argument(
                "port_fov_deg, port_range", f"found {found}, expected 0 to 170 and 0 to 10000"
            )


@dataclass(frozen=True, kw_only=True)
class LandmarksCommand(Command):
    """Choose landmarks of a target for the estimate of its pose: corners of its mesh, and from where each is seen."""

    work = "vision.landmarks:landmarks"
    prepares_jax = False

    mesh: Positional[Mesh] = "target"
    placement: Annotated[MeshPlacement, FLAT]
    port: Annotated[PortOptions, FLAT]
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as target.landmarks.safetensors.")]
    count: Annotated[int, arg(metavar="N", help="Landmarks at most.")] = 20
    points: Annotated[
        Path | None, arg(metavar="FILE", help="Places to take in place of a choice: a JSON list of [x, y, z] in m.")
    ] = None
    picture: Annotated[Path | None, arg(metavar="PNG", help="Write a picture of the mesh with its landmarks.")] = None
    force: Annotated[bool, arg(help="Replace files that are there.")] = False
    as_json: AsJson = False


LandmarkFile = Annotated[
    Path | None, arg(metavar="FILE", help="Landmarks of the mesh; by default those of the packaged target.")
]
"""Which landmarks a network finds."""
PoseRanges = Annotated[
    tuple[float, float], arg(metavar="LOW HIGH", help="Least and largest range, evenly in their logarithm [m].")
]


@dataclass(frozen=True, kw_only=True)
class TrainPoseCommand(Command):
    """Ray-trace a target and train the network that finds its landmarks; an interrupted call continues."""

    work = "vision.pose:train"

    mesh: Mesh = "target"
    placement: Annotated[MeshPlacement, FLAT]
    landmarks: LandmarkFile = None
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as target.pose.safetensors.")]
    views: Annotated[int, arg(metavar="N", help="Ray-traced views.")] = 2496
    epochs: Annotated[int, arg(metavar="N", help="Passes over the views, each in two crops.")] = 150
    minutes: Annotated[
        float | None, arg(metavar="T", help="Time limit of the training [min]; the schedule adapts.")
    ] = None
    range_m: PoseRanges = (1.2, 20.0)
    start: Annotated[Path | None, arg(metavar="FILE", help="Network to start from, instead of random weights.")] = None
    rate: Annotated[float, arg(metavar="R", help="Peak learning rate.")] = 5e-3
    seed: NetworkSeed = 0
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    as_json: AsJson = False

    def __post_init__(self) -> None:
        least = 64
        if self.views < least or self.epochs < 1:
            found = f"{self.views}, {self.epochs}"
            raise RpojaxError.of_argument("views, epochs", f"found {found}, expected at least {least} and 1")
        if self.minutes is not None and not self.minutes > 0.0:
            raise RpojaxError.of_argument("minutes", f"found {self.minutes}, expected a time above 0")
        if not 0.0 < self.rate < 1.0:
            raise RpojaxError.of_argument("rate", f"found {self.rate}, expected a number between 0 and 1")
        check_target(self.mesh, self.landmarks, self.range_m)
        check_seed(self.seed)


@dataclass(frozen=True, kw_only=True)
class EvaluatePoseCommand(Command):
    """Evaluate a landmark network on ray-traced pictures that no training has: landmarks, and poses of one picture."""

    work = "vision.pose:evaluate"
    prepares_jax = False

    network: Annotated[
        Positional[Path | None], arg(metavar="NETWORK", help="Network; that of the packaged target by default.")
    ] = None
    mesh: Mesh = "target"
    placement: Annotated[MeshPlacement, FLAT]
    landmarks: LandmarkFile = None
    out: Annotated[
        Path,
        arg(metavar="DIR", help="Folder for evaluation.json and the traced views, which are used again."),
    ]
    views: Annotated[int, arg(metavar="N", help="Pictures.")] = 1000
    range_m: PoseRanges = (1.2, 30.0)
    samples: Annotated[int, arg(metavar="N", help="Samples per pixel of the ray tracer.")] = 16
    detector: Annotated[Path | None, arg(metavar="FILE", help="Detector; the packaged one by default.")] = None
    seed: ViewSeed = 0
    force: Annotated[bool, arg(help="Replace evaluation.json if it is there.")] = False
    as_json: AsJson = False

    def __post_init__(self) -> None:
        if self.views < 1 or self.samples < 1:
            raise RpojaxError.of_argument("views, samples", f"found {self.views}, {self.samples}, expected at least 1")
        check_target(self.mesh, self.landmarks, self.range_m)
        check_seed(self.seed)


def check_target(mesh: str, landmarks: Path | None, range_m: tuple[float, float]) -> None:
    """Refuses a mesh without its landmarks, landmarks without their mesh, and ranges that do not rise."""
    low, high = range_m
    if not 0.1 <= low < high < 1e4:
        raise RpojaxError.of_argument("range_m", f"found {low} {high}, expected two rising numbers of 0.1 to 10000")
    if (mesh == "target") != (landmarks is None):
        found = f"{mesh}, {'none' if landmarks is None else landmarks}"
        raise RpojaxError.of_argument(
            "mesh, landmarks", f"found {found}, expected a mesh file with its landmarks, or neither"
        )
