"""Contact sheet of the camera images of the run that is shown in detail."""

from dataclasses import dataclass
from pathlib import Path

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import RpojaxError
from rpojax.report.campaign_results import CampaignResults


@dataclass(frozen=True)
class CameraSheet:
    """File of a contact sheet, or the reason why there is none."""

    path: Path | None
    reason: str = ""


def write_camera_sheet(campaign: CampaignResults, run_id: int | None) -> CameraSheet:
    """Renders camera images of a run again and writes them as figures/camera.jpg in the campaign's folder.

    Of a team they are those of its first servicer.
    """
    if run_id is None:
        return CameraSheet(None, "No full history was kept.")
    # Imported here because rendering imports the simulation.
    from rpojax.campaign import rerender
    from rpojax.campaign.options.campaign_options import CampaignOptions
    from rpojax.report.figures.camera import camera_stills

    if campaign.info["scenario"].get("camera", {}).get("model") != "rendered":
        return CameraSheet(None, "The scenario's camera renders no images.")
    try:
        file = rerender.rendered_scenario(campaign.info["scenario"], campaign.info["scenario_hash"])
        history = campaign.history(run_id, 0)
        if not rerender.is_renderable(history, file):
            return CameraSheet(None, "The history of this run was not kept in full.")
        ticks = camera_stills.select_stills(history, rerender.valid_tick_count(history))
        options = CampaignOptions.from_record(campaign.info)
        sheet = camera_stills.contact_sheet(
            rerender.render_images(
                file, options.seed, run_id, history, ticks, options.design_range, 0 if campaign.servicer_names else None
            )
        )
    except RpojaxError as error:
        return CameraSheet(None, f"The images cannot be rendered again: {error}.")
    return CameraSheet(write_atomically(campaign.directory / "figures" / "camera.jpg", camera_stills.jpeg_bytes(sheet)))
