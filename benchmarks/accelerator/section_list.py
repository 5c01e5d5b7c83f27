"""Sections of a sitting, in order of importance."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Section:
    """What one process of the sitting measures.

    Attributes:
        name: in results and options
        module: of this package, with a function `measure` of the sizes and `arguments` that yields entries
        expected_s: time that it takes on an accelerator; it is not begun with less than that left [s]
        arguments: further arguments of `measure`
        rendered: whether images are rendered, for which a CPU needs other flags of XLA
    """

    name: str
    module: str
    expected_s: float
    arguments: tuple[str, ...] = ()
    rendered: bool = False


PLATFORM = Section("platform", "platform_entry", 0.0)
"""Measured before all others: it decides between the sizes."""

SECTIONS = (
    Section("loop_single", "loop_speed", 60.0, ("single",)),
    Section("loop_double", "loop_speed", 60.0, ("double",)),
    Section("precision", "precision_statistics", 50.0),
    Section("camera", "camera_speed", 40.0, rendered=True),
    Section("gradient", "gradient_speed", 90.0),
    Section("rendered_loop", "rendered_loop_speed", 40.0, rendered=True),
    Section("training", "training_speed", 30.0),
    Section("batches_single", "batch_sweep", 30.0, ("single",)),
    Section("batches_double", "batch_sweep", 30.0, ("double",)),
)


def section_named(name: str) -> Section:
    """The section of that name."""
    return next(section for section in (PLATFORM, *SECTIONS) if section.name == name)
