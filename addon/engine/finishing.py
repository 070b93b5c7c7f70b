"""What happens to a traced picture before Blender has it for good: where the scene asks for it, the noise goes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from raytracer.film.film import Film

from ..denoising.process import DenoiseCancelledError, DenoiseError, denoise
from ..extract.warnings import Warning
from .output import RenderOutput

# The passes, where a view layer asks for them, by which edges of things are told from noise: by the node's inputs.
GUIDES = {"Albedo": "Denoising Albedo", "Normal": "Denoising Normal"}
# What the metadata of a denoised picture says.
NOTE_DENOISED = (("Denoised", "OpenImageDenoise"),)


def is_finished_later(engine: Any, scene: Any, film: Film) -> bool:
    """Return whether the picture is to be denoised once it is traced."""
    return bool(scene.reference_raytracer.use_denoising) and not engine.is_preview and not film.cancelled


def finish_picture(
    engine: Any, scene: Any, film: Film, output: RenderOutput, on_stage: Callable[[str], None]
) -> tuple[bool, tuple[Warning, ...]]:
    """Write the film with Combined without its noise where that is wanted; return whether it was, and warnings why not.

    A picture that the user stopped stays as it is: to wait for more is what they did not want.
    """
    if not is_finished_later(engine, scene, film):
        return False, ()
    on_stage("Denoising")
    try:
        guides = {place: film[name] for place, name in GUIDES.items() if set(GUIDES.values()) <= set(film.names)}
        denoised = denoise(film["Combined"], guides, engine.test_break)
    except DenoiseCancelledError:
        return False, ()
    except (DenoiseError, MemoryError) as error:
        reason = "not enough memory" if isinstance(error, MemoryError) else error
        return False, (Warning(f"Denoise: {reason}; the picture is as it was traced"),)
    output.write_film(film, Combined=denoised)
    output.note(NOTE_DENOISED)
    return True, ()
