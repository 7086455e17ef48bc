"""Picture of a solved scene by ray casting, and its linear layers: radiance, irradiance, albedo, coverage."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.draw import raycast, visible
from app.draw.bare_lights import light_faces
from app.draw.camera import Bounds, Turntable, from_camera, scene_bounds
from app.draw.draw_mesh import along_light, dimmed, meshes_of
from app.draw.false_colour import Display, Scale, automatic_scale, fixed_scale
from app.draw.fine_mesh import fine_light, fine_meshes, fine_points_of
from app.draw.legend import of_scale, with_legend
from app.draw.lit_scene import LitScene, metered
from app.draw.reflected import sharp_gloss
from app.draw.still import PixelIrradiance, pixel_irradiance
from app.draw.tonemap import BACKGROUND, NEUTRAL, UNLIT, gains_for
from app.draw.visible import PIXEL_OFFSETS, PictureView
from app.settings import FALSE_COLOURS, ILLUMINANCE, Settings
from gi_core.display.fine_points import FinePoints
from gi_core.scene.types import UNITS
from gi_core.solver import Solver

Progress = Callable[[float], None]
LightOfPixels = Callable[[LitScene, visible.PictureScene], PixelIrradiance | None]


class Shot:
    """A solved scene with camera and exposure."""

    def __init__(self, solver: Solver, settings: Settings, paths: int | None = None) -> None:
        """paths: whole ones per pixel, 0: light per pixel, see still.py; None: light at vertices."""
        self.solver, self.settings, self.paths = solver, settings, paths
        model = solver.model
        self._meshes = self._pictured = meshes_of(model)
        self._fine: FinePoints | None = None
        self.camera = home_camera(solver)
        flux = solver.model.emitters.total_flux
        self.gains = gains_for(flux) if settings.white_balance else NEUTRAL
        self.scale: Scale | None = None  # of false colours
        self.report: Callable[[str, float], None] = lambda stage, fraction: None
        self.exposure = settings.exposure
        if self.exposure is None:
            self.exposure = solver.scene.defaults.exposure

    def refine(self) -> None:
        """Draw with the fine points of the present poses, where its direct light is known."""
        self.settle()
        if self.paths is not None and not any(mesh.reflectors for mesh in self._meshes):
            return  # but reflections show light at vertices
        *_, self._fine = None, *fine_points_of(self.solver, self._meshes)
        if self._fine is not None:
            self._pictured = fine_meshes(self._meshes, self._fine)

    @property
    def lit(self) -> LitScene:
        """The scene and the light that the picture shows, of receivers and fine points."""
        s, of_receivers = self.solver, self._of_receivers
        if self._fine is None:
            return of_receivers
        drawn = fine_light(s, self._fine).of(of_receivers.drawn)
        return replace(of_receivers, meshes=dimmed(self._pictured, s.levels), drawn=drawn)

    @property
    def _of_receivers(self) -> LitScene:
        s, radiance, units = self.solver, self.settings.shows_radiance, UNITS[self.solver.scene.units]
        meshes, drawn = dimmed(self._meshes, s.levels), s.drawn(s.irradiance)
        return LitScene(s.model, s.poses, s.levels, meshes, drawn, s.frame.gloss, radiance, units)

    @property
    def view(self) -> PictureView:
        """Camera and pixels."""
        camera = self.camera.relative_to(self.solver.model.origins[0])
        return PictureView(camera, *self.settings.size, self.settings.cull)

    def take(self, progress=lambda fraction: None) -> np.ndarray:
        """Return the picture (h, w, 3) uint8; the first one fixes the settings left open."""
        self.settle()
        lit = self.lit
        display = Display(self.exposure, self.settings.tone_map, self.gains, self.scale)
        taken = picture(lit, self.view, display, progress=progress, light=self.pixel_light)
        return taken if self.scale is None else with_legend(taken, of_scale(self.scale, lit.units))

    def pixel_light(self, lit: LitScene, world: visible.PictureScene) -> PixelIrradiance | None:
        """Return the light of a picture's pixels by rays; None: that of vertices serves."""
        if self.paths is None:
            return None
        return pixel_irradiance(self.solver, lit, world, self.view, self._fine, self.paths, self.report)

    def expose(self) -> None:
        """Meter the exposure unless it is known."""
        if self.exposure is None:
            self.exposure = self.metered()

    def settle(self) -> None:
        """Settle exposure and scale of false colours: those of the settings, else those that suit the picture."""
        self.expose()
        s = self.settings
        if self.scale is None and s.show in FALSE_COLOURS:
            ends = s.false_colour_range
            scale = automatic_scale(self._seen(), s.show) if ends is None else fixed_scale(*ends, s.show)
            self.scale = scale.with_lines(s.false_colour_lines)

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
        unit = UNITS[self.solver.scene.units].per_area
        low, high = (f"{E:.3g}" if E < 1000 else f"{E:.0f}" for E in (seen.min(), seen.max()))
        lines = ", ".join(f"{line:g}" for line in scale.lines) or "nowhere on its scale"
        return f"no isolines: the picture has about {low} to {high} {unit}, they are at {lines}"

    def _seen(self) -> np.ndarray:
        """Return the light (n,) of the visible surface, of the quantity shown."""
        camera, width, height, cull = self.view
        return raycast.visible_light(self._of_receivers, camera, width / height, cull)

    def metered(self) -> float:
        """Return the exposure [EV] that suits the picture."""
        return metered(self._of_receivers, self.camera, self.solver.scene_size)


def home_camera(solver: Solver) -> Turntable:
    """Return the viewer's initial camera."""
    lit = Bounds(tuple(solver.chosen.low), tuple(solver.chosen.high))
    return from_camera(solver.scene.camera, solver.scene.up, scene_bounds(solver.model, solver.poses), lit)


class Layers(NamedTuple):
    """Means over pixels; 0 where nothing is seen, and on the backs of one-sided faces."""

    colour: np.ndarray  # (h, w, 3) float32, radiance [W/m2/sr], without exposure and white balance
    irradiance: np.ndarray  # (h, w, 3) float32 [W/m2]
    albedo: np.ndarray  # (h, w, 3) float32, reflectance with textures
    coverage: np.ndarray  # (h, w, 1) float32, 0 .. 1
    variance: np.ndarray | None = None  # (h, w, 3) float32, of colour; None: not by rays


def picture(
    lit: LitScene, view: PictureView, display: Display, progress: Progress = lambda fraction: None,
    light: LightOfPixels = lambda lit, world: None,
) -> np.ndarray:  # fmt: skip
    """Return a picture (height, width, 3) uint8; light: of pixels by rays.

    Tone map and background follow the renderer.
    """
    world, gloss = _placed(lit), lit.gloss_towards(view.camera.eye())
    faces, above = raycast.both_sides(world, lit.sides, lit.weights), raycast.above_textures(world, lit, gloss)
    sharp = sharp_gloss(lit, view, display, gloss)
    pixels = light(lit, world)
    under = lit if pixels is None else replace(lit, drawn=pixels.vertices)
    drawn = raycast.both_sides(world, under.sides, lit.weights)
    bare = _bare(lit, world) if lit.shows_radiance else None
    lamps = light_faces(lit.model, lit.levels) if lit.shows_radiance else None
    pixel = raycast.pixel_steps(view.camera, view.height)
    steps = pixel if lit.shows_radiance and world.textures else None
    isolines = display.scale is not None and bool(display.scale.lines)
    out = np.empty((view.height, view.width, 3), np.uint8)

    def draw(strip: visible.Strip) -> None:
        # Mean after the tone map, as in a GL framebuffer: a saturated lamp keeps clean edges.
        colours = np.tile(np.round(np.array(BACKGROUND) * 255).astype(np.uint8), (len(strip.face), 1))
        glazed = display.scale is None and lit.shows_radiance and len(strip.panes) > 0
        if glazed:
            through, veil = raycast.by_panes(faces, strip)
            behind = through + veil * 2.0**display.exposure * display.gains  # the shader knows their sum alone
            colours[:] = np.round(np.clip(np.array(BACKGROUND) * behind, 0, 1) * 255)
        if lamps is not None and display.scale is None and len(rays := lamps.open_to_sky(strip)):
            sky = lamps.sky.seen(strip.directions[rays])
            colours[rays] = display.colours(sky * through[rays] + veil[rays] if glazed else sky)
        hit = np.flatnonzero(strip.face >= 0)
        if len(hit):
            seen = strip.seen(hit)
            radiance, facing = raycast.seen_radiance(drawn, *seen, steps, strip.eye)
            if pixels is not None:
                rho = 1.0 if bare is None else raycast.seen_radiance(bare, *seen, steps, strip.eye)[0]
                radiance = np.maximum(radiance + rho * pixels.at(strip, hit) / math.pi, 0.0)
            if above is not None:
                radiance += raycast.gloss_seen(faces, strip, hit, above, sharp, radiance)
            if glazed:
                radiance = radiance * through[hit] + veil[hit]
            slope = raycast.gradient(faces, *seen, facing, pixel, strip.eye) if isolines else None
            to_middle = 0.5 - PIXEL_OFFSETS[hit % len(PIXEL_OFFSETS)]  # a line is the same in all samples, as in GL
            colours[hit] = display.colours(radiance, slope, to_middle)
            colours[hit[~facing & world.one_sided[strip.face[hit]]]] = np.round(np.array(UNLIT) * 255)
        if lamps is not None:
            rays, radiance = lamps.seen(strip, world)
            colours[rays] = display.colours(radiance)
        out[strip.rows] = np.round(strip.resolved(colours))

    visible.draw_strips(draw, lit, world, view, progress, None if pixels is None else pixels.strips)
    return out


def layers(shot: Shot, progress: Progress = lambda fraction: None) -> Layers:
    """Return the layers of a shot, at the size of its settings."""
    shot.expose()  # as the first reflections
    lit, view = replace(shot.lit, shows_radiance=True), shot.view
    gloss, world = lit.gloss_towards(view.camera.eye()), _placed(lit)
    sharp = sharp_gloss(lit, view, Display(shot.exposure, gains=shot.gains), gloss)
    faces, above = raycast.both_sides(world, lit.sides, lit.weights), raycast.above_textures(world, lit, gloss)
    lamps = light_faces(lit.model, lit.levels)
    bare, pixels = _bare(lit, world), shot.pixel_light(lit, world)
    kept = lit if pixels is None else replace(lit, drawn=pixels.vertices)
    drawn = raycast.both_sides(world, kept.sides, lit.weights)
    white = raycast.both_sides(world, replace(kept, shows_radiance=False).sides, lit.weights)
    steps = raycast.pixel_steps(view.camera, view.height) if world.textures else None
    channels = (3, 3, 3, 1) if pixels is None else (3, 3, 3, 1, 3)
    out = Layers(*(np.zeros((view.height, view.width, k), np.float32) for k in channels))

    def draw(strip: visible.Strip) -> None:
        hit = np.flatnonzero(strip.face >= 0)
        seen = strip.seen(hit)
        light, facing = raycast.seen_radiance(drawn, *seen, steps, strip.eye)
        E = math.pi * raycast.seen_radiance(white, *seen, None, strip.eye)[0]
        rho = raycast.seen_radiance(bare, *seen, steps, strip.eye)[0]
        if pixels is not None:
            more = pixels.at(strip, hit)
            E, light = np.maximum(E + more, 0.0), np.maximum(light + rho * more / math.pi, 0.0)
        if above is not None:
            light = light + raycast.gloss_seen(faces, strip, hit, above, sharp, light)
        on = (facing | ~world.one_sided[seen[0]])[:, None]
        rays, bright = lamps.seen(strip, world)
        through, veil = raycast.by_panes(faces, strip)
        light = light * on * through[hit] + veil[hit]
        values_of = [light, E * on, rho * on, np.ones((len(hit), 1))]
        if pixels is not None:
            values_of.append((rho * on * through[hit] / math.pi) ** 2 * pixels.variance_at(strip, hit)[:, None])
        for layer, values in zip(out, values_of, strict=False):
            of_rays = np.zeros((len(strip.face), values.shape[1]))
            of_rays[hit] = values
            of_rays[rays] = bright if layer is out.colour else float(layer is out.coverage)
            assert layer is not None
            layer[strip.rows] = strip.resolved(of_rays)

    visible.draw_strips(draw, lit, world, view, progress, None if pixels is None else pixels.strips)
    return out


def _bare(lit: LitScene, world: visible.PictureScene) -> raycast.Coloured:
    """Return reflectance as colours of vertices."""
    dark = world._replace(emission=np.zeros_like(world.emission))
    return raycast.both_sides(dark, [(m.reflectance, m.reflectance) for m in lit.meshes], [None] * len(lit.meshes))


def _placed(lit: LitScene) -> visible.PictureScene:
    """Return the meshes in world space, with the diagonals that suit their colours."""
    meshes = zip(lit.meshes, lit.sides, lit.weights, strict=True)
    return visible.place([along_light(mesh, *colours, w) for mesh, colours, w in meshes], lit.at)
