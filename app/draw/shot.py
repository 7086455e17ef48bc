"""Picture of a solved scene by ray casting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from app.draw import raycast
from app.draw.bare_lights import LightFaces, light_faces
from app.draw.camera import Bounds, Turntable, from_camera, scene_bounds
from app.draw.draw_mesh import DrawMesh, dimmed, meshes_of
from app.draw.false_colour import Scale, automatic_scale, fixed_scale
from app.draw.legend import of_scale, with_legend
from app.draw.metering import metered
from app.draw.reflected import Mirrors
from app.draw.tonemap import BACKGROUND, NEUTRAL, gains_for, srgb_decode
from app.draw.units import units_of
from app.draw.vertex_colours import Gloss, colours, gloss_towards, weights
from app.settings import FALSE_COLOURS, ILLUMINANCE, Settings

if TYPE_CHECKING:
    from gi_core.solver import Solver


class Shot:
    """A solved scene with camera and exposure."""

    def __init__(self, solver: Solver, settings: Settings) -> None:
        self.solver, self.settings = solver, settings
        model = solver.model
        self._meshes = meshes_of(model)
        self.camera = home_camera(solver)
        flux = solver.model.emitters.total_flux
        self.gains = gains_for(flux) if settings.white_balance else NEUTRAL
        self.scale: Scale | None = None  # of false colours
        self.exposure = settings.exposure
        if self.exposure is None:
            self.exposure = solver.scene.defaults.exposure

    @property
    def meshes(self) -> tuple[DrawMesh, ...]:
        """Draw meshes, the static part first; lamps emit at the solver's levels."""
        return dimmed(self._meshes, self.solver.levels)

    def colours(self, o: int) -> tuple[np.ndarray, np.ndarray]:
        """Return linear radiance of front and back (D, 3) of object o."""
        drawn = self.solver.drawn(self.solver.irradiance).irradiance
        return colours(self.meshes[o], drawn, self.settings.shows_radiance)

    def gloss(self, eye: np.ndarray | None = None, other: Gloss | None = None) -> Gloss:
        """Return the gloss of all objects; eye (3,): None: the camera's; other: as for gloss_towards()."""
        s = self.solver
        light = s.frame.gloss if self.settings.shows_radiance else None
        eye = self.camera.relative_to(s.model.origins[0]).eye() if eye is None else eye
        at, E = s.model.transforms(s.poses), s.drawn(s.irradiance).irradiance
        return gloss_towards(self.meshes, light, E, at, eye, other)

    def sharp(self) -> raycast.Sharp | None:
        """Return reflections in sharp gloss; None: there are none."""
        s, meshes, camera = self.solver, self.meshes, self.camera.relative_to(self.solver.model.origins[0])
        if s.frame.gloss is None or not self.settings.shows_radiance or not any(m.reflectors for m in meshes):
            return None
        weights = [self.weights(o) for o in range(len(meshes))]
        exposure = self.metered() if self.exposure is None else self.exposure
        around = srgb_decode(np.array(BACKGROUND)) / (2.0**exposure * np.array(self.gains))
        pixel = 2 * math.tan(camera.fov / 2) / self.settings.size[1] if any(m.textures for m in meshes) else None
        lights = s.model.lights_at(s.levels)
        of_camera = self.gloss()

        def gloss(eye: np.ndarray) -> Gloss:
            return self.gloss(eye, of_camera)

        at, cull, height = s.model.transforms(s.poses), self.settings.cull, self.settings.size[1]
        return Mirrors(
            s.model.accelerator, at, meshes, gloss, weights, camera.eye(), pixel, cull, around, lights, exposure, height
        ).reflected

    def light_faces(self) -> LightFaces:
        """Return the bright faces of the luminaires."""
        return light_faces(self.solver.model, self.solver.levels)

    def weights(self, o: int) -> np.ndarray | None:
        """Return interpolation weights of front and back (D, 2); None: all 1."""
        return weights(self.meshes[o], self.solver.drawn(self.solver.irradiance).weights)

    def take(self, progress=lambda fraction: None) -> np.ndarray:
        """Return the picture (h, w, 3) uint8; the first one fixes the settings left open."""
        self.expose()
        if self.scale is None:
            self.scale = self.fitted_scale()
        model, s = self.solver.model, self.settings
        picture = raycast.picture(
            model.accelerator,
            model.transforms(self.solver.poses),
            self.meshes,
            [self.colours(o) for o in range(len(self.meshes))],
            self.camera.relative_to(model.origins[0]),
            s.size,
            self.exposure,
            s.tone_map,
            s.cull,
            progress,
            s.shows_radiance,
            [self.weights(o) for o in range(len(self.meshes))],
            self.scale,
            self.gains,
            self.gloss(),
            self.sharp(),
            self.light_faces() if s.shows_radiance else None,
        )
        return (
            picture
            if self.scale is None
            else with_legend(picture, of_scale(self.scale, units_of(self.solver.scene.units)))
        )

    def expose(self) -> None:
        """Meter the exposure unless it is known."""
        if self.exposure is None:
            self.exposure = self.metered()

    def fitted_scale(self) -> Scale | None:
        """Return the scale of false colours that the settings give or that suits the picture; None: other pictures."""
        s = self.settings
        if s.show not in FALSE_COLOURS:
            return None
        if (ends := s.false_colour_range) is not None:
            return fixed_scale(*ends, s.show).with_lines(s.false_colour_lines)
        return automatic_scale(self._seen(), s.show).with_lines(s.false_colour_lines)

    def without_isolines(self) -> str:
        """Return why the picture taken has none of the isolines asked for, as a sentence; "": it has, or none are."""
        s, scale = self.settings, self.scale
        if s.isolines is None:
            return ""
        if s.show != ILLUMINANCE:
            return "no isolines: they lie over false colours, ask for --show illuminance"
        seen = self._seen()
        seen = seen[np.isfinite(seen)]
        if scale is None or not len(seen) or any(seen.min() <= line <= seen.max() for line in scale.lines):
            return ""
        unit = units_of(self.solver.scene.units).per_area
        low, high = (f"{E:.3g}" if E < 1000 else f"{E:.0f}" for E in (seen.min(), seen.max()))
        lines = ", ".join(f"{line:g}" for line in scale.lines) or "nowhere on its scale"
        return f"no isolines: the picture has about {low} to {high} {unit}, they are at {lines}"

    def _seen(self) -> np.ndarray:
        """Return the light (n,) of the visible surface, of the quantity shown."""
        s, solver = self.settings, self.solver
        model, drawn = solver.model, solver.drawn(solver.irradiance)
        at, camera = model.transforms(solver.poses), self.camera.relative_to(model.origins[0])
        width, height = s.size
        view = model.accelerator, at, self.meshes, drawn, camera, width / height, s.cull
        return raycast.visible_light(*view, s.show, solver.frame.gloss)

    def metered(self) -> float:
        """Return the exposure [EV] that suits the picture."""
        s, textured = self.solver, self.settings.shows_radiance
        gloss = self.gloss()
        return metered(s.receivers, self.meshes, self.colours, gloss, textured, s.scene_size, self.camera)


def home_camera(solver: Solver) -> Turntable:
    """Return the viewer's initial camera."""
    lit = Bounds(tuple(solver.chosen.low), tuple(solver.chosen.high))
    return from_camera(solver.scene.camera, solver.scene.up, scene_bounds(solver.model, solver.poses), lit)
