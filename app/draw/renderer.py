"""OpenGL 3.3 renderer into a texture, on any context.

Positions and textures are uploaded once, colours when the light changes: linear float32, because packing costs more
than it saves. Texture, exposure, tone map and sRGB are applied per fragment.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import moderngl
import numpy as np

from app.draw.bare_lights import HIGHLIGHTS, BareLights, LightFaces
from app.draw.colour_map import SEQUENTIAL
from app.draw.draw_mesh import DrawMesh
from app.draw.false_colour import LIGHT_FROM, LINE_OPACITY, LINE_PIXELS, Scale, false_colours
from app.draw.gl_mirrors import BACKDROP, GLCoverage, GLMirrors, Shares, View
from app.draw.gl_objects import DrawnObject
from app.draw.gl_targets import LinearTarget, Programs, Targets, put, smooth_edges
from app.draw.gl_textures import GlossTexture, GLTextures
from app.draw.tonemap import BACKGROUND, NEUTRAL, TONE_MAPS, UNLIT, Gains, to_display
from app.settings import DEFAULT_TONE_MAP, LUMINANCE
from app.values import MOST_ISOLINES
from gi_core.geometry.texture_filter import MOST_REFLECTANCE
from gi_core.gloss.hemisphere import CELLS
from gi_core.gloss.light import Directions, GlossLight
from gi_core.gloss.reflectors import PLANAR, PROBE, Reflector

SAMPLES = 4  # per pixel; a picture of one has its edges smoothed
OUTLINE = (1.0, 0.78, 0.32, 0.95)
# Codes of surface.frag: tone maps, display colours as they are, false colours, linear light.
TONE_MAP_CODES = {
    "clip": 0, "reinhard": 1, "aces": 2, "as is": 3, "false colours": 4, "reflection": 5, "compressed reflection": 6,
    "agx": 7, "neutral": 8, "linear": 9,
}  # fmt: skip
SKY_UNIT = 5
GLOSS_UNITS = {"cells": 1, "owners": 4}  # texture units; 2 and 3 are reflections
NO_SCALE = Scale(0.0, 1.0, False)


@dataclass(frozen=True, eq=False)
class Look:
    """Parameters of a drawn frame."""

    view_projection: np.ndarray  # (4, 4) float64 world to clip
    models: tuple[np.ndarray, ...]  # (4, 4) float64 object to world, static part first
    exposure: float = 0.0  # [EV]
    tone_map: str = DEFAULT_TONE_MAP
    cull: bool = True
    outlined: tuple[int, ...] = ()  # objects with an outline: selected ones
    pointed: int = -1  # the object with a lighter one: under the cursor
    surface: np.ndarray | None = None  # (k,) faces of the static part with an outline where they are seen
    surface_opacity: float = 1.0  # of that outline
    outline_width: float = 2.0  # pixels
    textured: bool = True  # multiply colours by textures
    as_is: bool = False  # colours are display colours: no exposure, no tone map
    line_scale: float = 1.0  # of the width of isolines, for fine screens
    scale: Scale | None = None  # of false colours, in place of the tone map
    gains: Gains = NEUTRAL  # of the white balance
    eye: np.ndarray | None = None  # (3,) [m], for gloss; None: there is none

    @property
    def is_light(self) -> bool:
        """Whether the picture shows radiance, or false colours of it."""
        return self.textured and not self.as_is and (self.scale is None or self.scale.quantity == LUMINANCE)


class Renderer:
    """GL objects of one scene and one picture. Those that nothing refers to any more are freed after each picture."""

    def __init__(self, ctx: moderngl.Context, samples: int = SAMPLES) -> None:
        self.ctx = ctx
        ctx.gc_mode = "context_gc"  # objects are freed by ctx.gc(), in the thread of this context
        self._programs = Programs(ctx)
        self._mask = self._programs.of("surface.vert", "mask.frag")
        self._textures, self._gloss = GLTextures(ctx), GlossTexture(ctx)
        self._mirrors, self._coverage = GLMirrors(ctx, ()), GLCoverage(ctx, samples)
        self._dome: tuple[tuple, moderngl.Texture] | None = None  # key of its colours, and a texel per patch
        self._linear: LinearTarget | None = None  # of pictures with panes; None: there was none
        self._lights: BareLights | None = None
        self._faces = LightFaces(np.zeros((0, 4, 3)), np.zeros((0, 3)))
        self._bright: DrawnObject | None = None  # these faces; None: there are none
        self._objects: list[DrawnObject] = []
        self._targets: Targets | None = None
        # Bound after each picture: the GUI draws to it next, and a bound framebuffer must not be freed.
        self._default = ctx.detect_framebuffer(0)
        self.samples = samples

    def set_scene(self, meshes: tuple[DrawMesh, ...]) -> None:
        """Upload the geometry, one DrawMesh per object; after an exception the old geometry stays.

        Meshes that differ from the last ones in emission alone are not uploaded again.
        """
        kept = {k: o for k, (o, mesh) in enumerate(zip(self._objects, meshes, strict=False)) if o.draws(mesh)}
        if len(kept) == len(meshes) == len(self._objects):
            return
        made = [kept[k] if k in kept else DrawnObject(self.ctx, self._mask, mesh) for k, mesh in enumerate(meshes)]
        self._textures.keep(t for mesh in meshes for t in mesh.textures)
        self._objects, self._gloss, self._mirrors = made, GlossTexture(self.ctx), GLMirrors(self.ctx, meshes)
        self._coverage.forget()

    def set_colours(self, o: int, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None) -> None:
        """Upload linear radiance (D, 3) of both sides of an object's draw vertices.

        weights (D, 2): interpolation weights of front and back; None: all 1.
        """
        self._objects[o].upload(front, back, weights)
        self._mirrors.forget()

    def set_gloss(self, light: GlossLight | None) -> None:
        """Upload the directional light of the glossy receivers; None: there are none."""
        self._gloss.upload(light)
        self._mirrors.forget()

    def set_lights(self, lights: BareLights | None) -> None:
        """Show lights without a surface in sharp gloss; None: no mesh has any."""
        self._lights = lights
        for k, o in enumerate(self._objects):
            o.shine(None if lights is None else lights.strength[k])
        self._mirrors.forget()

    def set_light_faces(self, faces: LightFaces) -> None:
        """Show the faces of luminaires, and the sky."""
        now, before = ([of.corners, of.radiance, *map(np.asarray, of.sky)] for of in (faces, self._faces))
        if all(np.array_equal(a, b) for a, b in zip(now, before, strict=True)):
            return
        self._mirrors.forget()
        self._faces, self._bright = faces, None
        if len(faces.corners):
            mesh = faces.mesh
            self._bright = DrawnObject(self.ctx, self._mask, mesh)
            self._bright.upload(mesh.emission, mesh.emission)

    def set_irradiance(self, o: int, irradiance: np.ndarray) -> None:
        """Upload irradiance (R, 3) [W/m2] under the gloss of an object, if it has any."""
        if self._objects[o].mesh.gloss is not None:
            self._objects[o].light(irradiance)
            self._mirrors.forget()

    def dim(self, meshes: tuple[DrawMesh, ...]) -> None:
        """Set the emission of all objects to that of these meshes, which differ from set_scene()'s in nothing else."""
        for mesh, drawn in zip(meshes, self._objects, strict=True):
            drawn.dim(mesh.emission)
        self._mirrors.forget()

    def resize(self, width: int, height: int, samples: int | None = None) -> None:
        """Set the picture's size in pixels; the old one is freed first."""
        samples = min(self.samples if samples is None else samples, self.ctx.max_samples)
        size = (max(int(width), 1), max(int(height), 1))
        if self._targets is None or (self._targets.size, self._targets.samples) != (size, samples):
            self._targets = None
            self.ctx.gc()
            self._targets = Targets(self.ctx, size, samples)

    def draw(self, look: Look) -> None:
        """Draw a picture of the size set by `resize`."""
        targets, ctx = self._targets, self.ctx
        assert targets is not None, "resize first"
        directions: Directions | None = None
        if look.is_light and look.eye is not None and (light := self._gloss.light) is not None:
            for o, model in zip(self._objects, look.models, strict=True):
                if o.is_evaluated(light.tree is not None):
                    directions = light.directions() if directions is None else directions
                    o.evaluate(directions, _in_object(model, look.eye))
        linear = self._linear_target(look)
        drawn = targets.drawn if linear is None else linear.drawn
        drawn.use()
        drawn.clear(*((*BACKGROUND, 1.0) if linear is None else (1.0, 1.0, 1.0, 0.0)))
        mirrors = (PLANAR, PROBE) if self._draw_mirrors(look) else ()
        self._state()
        drawn.use()
        view = View(look.view_projection, look.eye, "ccw", mirrors, 0.0, targets.size)
        self._draw_scene(look, view, linear is not None)
        if linear is not None:
            self._draw_panes(look, linear)
            linear.tone_map(targets.picture, TONE_MAP_CODES[look.tone_map])
        elif drawn is not targets.picture:
            ctx.copy_framebuffer(targets.picture, drawn)
        if targets.samples <= 1:
            self._smooth_edges(look, drawn)
        if look.surface is not None:
            self._draw_outline_of_faces(targets, look, look.surface)
        for number in look.outlined:
            self._draw_outline(targets, look, number, OUTLINE)
        if look.pointed >= 0:
            self._draw_outline(targets, look, look.pointed, (0.95, 0.95, 0.95, 0.8))
        ctx.enable_only(ctx.NOTHING)
        self._default.use()
        ctx.gc()

    def _smooth_edges(self, look: Look, depths: moderngl.Framebuffer) -> None:
        def colours(o: int, edge: np.ndarray, face: np.ndarray) -> np.ndarray:
            light = self._objects[o].radiance_at(edge, face, look.textured)
            if look.as_is:
                return 255 * light
            if look.scale is not None:
                return false_colours(light, look.scale)
            return to_display(light, look.exposure, look.tone_map, look.gains)

        to_clip = [look.view_projection @ model for model in look.models]
        edges = [o.mesh.edges for o in self._objects]
        smooth_edges(self._targets.picture, depths, edges, to_clip, look.cull, colours)

    def _linear_target(self, look: Look) -> LinearTarget | None:
        """Return the target of a picture with panes, which is drawn before its tone map; None: it shows none."""
        has_panes = any(o.mesh.pane is not None for o in self._objects)
        if not (has_panes and look.is_light and look.scale is None and look.eye is not None):
            return None
        assert self._targets is not None
        self._linear = self._linear or LinearTarget(self.ctx, self._programs)
        self._linear.resize(self._targets.size, self._targets.samples)
        return self._linear

    def _draw_panes(self, look: Look, linear: LinearTarget) -> None:
        """Draw panes in any order: it shows in the light alone that one pane reflects behind another."""
        ctx, program = self.ctx, self._programs.of("pane.vert", "pane.frag")
        assert look.eye is not None
        ctx.enable(ctx.BLEND)
        ctx.blend_func = ctx.ONE, 0x88F9, ctx.ZERO, ctx.ONE  # type: ignore[assignment]  # GL_SRC1_COLOR
        linear.drawn.depth_mask = False
        program["eye_at"], program["exposure"] = tuple(look.eye), tuple(2.0**look.exposure * np.array(look.gains))
        for o, model in zip(self._objects, look.models, strict=True):
            if o.mesh.pane is not None:
                _place(program, look.view_projection, model)
                o.draw_panes(program)
        linear.drawn.depth_mask = True
        ctx.disable(ctx.BLEND)

    def _state(self) -> None:
        self.ctx.enable_only(self.ctx.DEPTH_TEST)
        self.ctx.depth_func, self.ctx.front_face, self.ctx.cull_face = "<", "ccw", "back"

    def _set_up(self, program: moderngl.Program, look: Look, view: View) -> None:
        """Set the uniforms that all objects share; the units of textures have been bound."""
        scale, light = look.scale or NO_SCALE, self._gloss.light
        put(
            program,
            exposure=tuple(2.0**look.exposure * gain for gain in look.gains),
            map=SEQUENTIAL.astype(np.float32).tobytes(),
            scale=scale[:3],
            of_luminance=scale.quantity == LUMINANCE,
            lines=(*scale.lines, *[0.0] * (MOST_ISOLINES - len(scale.lines))),
            line_count=len(scale.lines),
            line_look=(LINE_PIXELS * look.line_scale, LINE_OPACITY, LIGHT_FROM),
            unlit=UNLIT,
            reach=self._mirrors.size,
            single_rays=light is not None and light.tree is not None,
            layout_of=(self._gloss.lines, CELLS),
            image=0,
            brightest=MOST_REFLECTANCE,
            painted=float(look.textured),
            mirrored_view=view.gloss,
            **GLOSS_UNITS,
            **({} if view.eye is None else {"eye_at": tuple(view.eye)}),
        )

    def _set_up_lights(self, program: moderngl.Program) -> None:
        at, value = np.zeros((HIGHLIGHTS, 4), np.float32), np.zeros((HIGHLIGHTS, 3), np.float32)
        count = 0 if self._lights is None else len(self._lights.at)
        if self._lights is not None:
            at[:count], value[:count] = self._lights.at, self._lights.value
        put(program, lamp_count=count, lamp_at=at.tobytes(), lamp_value=value.tobytes())

    def _draw_sky(self, look: Look, view: View, mode: str) -> None:
        """Draw the sky, before all objects; mode: of TONE_MAP_CODES."""
        of, mirrored = self._faces.sky, view.gloss > 0
        if not of.radiance.any() or not look.is_light or (look.scale is not None and not mirrored):
            return
        key = id(self._faces), look.exposure, mode, tuple(look.gains)
        if self._dome is None or self._dome[0] != key:
            light, (rows, columns, _) = (of.radiance * of.shape).reshape(-1, 3), of.shape.shape
            if mode in TONE_MAPS:
                light = to_display(light, look.exposure, mode, look.gains) / 255
            else:
                light = 2.0**look.exposure * np.array(look.gains) * light
            self._dome = key, self.ctx.texture((columns, rows), 3, light.astype(np.float32).tobytes(), dtype="f4")
        self._dome[1].use(SKY_UNIT)
        sky = self._programs.of("screen.vert", "sky.frag")
        put(
            sky,
            direction_of=np.linalg.inv(view.view_projection[[0, 1, 3], :3]).T.astype(np.float32).tobytes(),
            pixels=tuple(map(float, view.size)),
            dome=SKY_UNIT,
            up=tuple(of.up),
            east=tuple(of.east),
            north=tuple(of.north),
            compressed=view.compressed,
            far=BACKDROP if mirrored else 1.0,
            everywhere=mirrored,
        )
        self.ctx.disable(self.ctx.DEPTH_TEST | self.ctx.CULL_FACE)
        self._programs.cover(sky)
        self.ctx.enable(self.ctx.DEPTH_TEST)

    def _draw_mirrors(self, look: Look) -> bool:
        """Draw the reflections of sharp gloss; return whether the picture shows it."""
        targets = self._targets
        if not look.is_light or look.eye is None or self._gloss.light is None or not self._mirrors:
            return False
        self._state()
        key = look.exposure, look.gains, look.cull
        draw, shares = partial(self._draw_scene, look), partial(self._shares, look)
        picture = View(look.view_projection, look.eye, "ccw", (PLANAR, PROBE), 0.0, targets.size)
        self._mirrors.draw(draw, shares, picture, look.models, min(SAMPLES, self.ctx.max_samples), key)
        return True

    def _shares(self, look: Look, view: View) -> Shares:
        """Return the share of a view that each reflector covers.

        From a probe, only planes count: without mobiles that have none, it is the same at all their poses.
        """
        objects = dict(enumerate(self._objects))
        if view.skipped >= 0:
            objects = {o: d for o, d in objects.items() if o == 0 or any(r.plane for r in d.mesh.reflectors)}

        def place(o: int) -> None:
            _place(self._mask, view.view_projection, look.models[o])

        self.ctx.front_face = view.front_face
        matrices = b"".join(
            np.ascontiguousarray(m).tobytes() for m in (view.view_projection, *(look.models[o] for o in objects))
        )
        key = matrices, view.size, view.front_face, view.skipped, look.cull
        shares = self._coverage.of(
            key, view.size, objects, place, look.cull, lambda reflector: view.skipped in reflector.omitted
        )
        self._state()
        return shares

    def _draw_scene(self, look: Look, view: View, is_linear: bool = False) -> None:
        """Draw all objects as a view sees them, but for panes; is_linear: before the tone map."""
        mirrored = view.gloss > 0
        self.ctx.front_face = view.front_face
        mode = "as is" if look.as_is else "false colours" if look.scale else look.tone_map
        if is_linear:
            mode = "linear"
        if mirrored:
            mode = "compressed reflection" if view.compressed else "reflection"
        self._draw_sky(look, view, mode)
        if shows_gloss := look.is_light and look.eye is not None and self._gloss.light is not None:
            self._gloss.use(**GLOSS_UNITS)
        ready: set[moderngl.Program] = set()

        def ready_program(*defines: str) -> moderngl.Program:
            program = self._programs.of("surface.vert", "surface.frag", f"TONE_MAP {TONE_MAP_CODES[mode]}", *defines)
            if program not in ready:
                self._set_up(program, look, view)
                if "SHARP" in defines:
                    self._mirrors.set_up(program)
                    self._set_up_lights(program)
                ready.add(program)
            return program

        for o, model in zip(self._objects, look.models, strict=True):
            kind = ["GLOSS"] * (o.mesh.gloss is not None and shows_gloss)

            def program_of(*defines: str, model=model, kind=kind) -> moderngl.Program:
                program = ready_program(*defines, *kind)
                _place(program, view.view_projection, model, view.eye)
                return program

            by_texture = o.mesh.uv is not None and (look.textured or o.has_holes)
            if not (by_texture or o.mesh.reflectors or o.mesh.pane is not None):
                o.draw(program_of(), look.cull)
                continue

            def sharp(reflector: Reflector, textured: bool, model=model) -> moderngl.Program | None:
                way = self._mirrors.way(reflector, view.mirrors)
                if way is None:
                    return None
                program = ready_program("SHARP", *["TEXTURED"] * textured)
                _place(program, view.view_projection, model)
                self._mirrors.use(program, reflector, model, way)
                return program

            def left_out(reflector: Reflector) -> bool:
                return view.skipped in reflector.omitted

            o.draw_calls(self._textures, look.cull, program_of, sharp, left_out)
        if self._bright is not None and look.is_light and not mirrored:
            program = ready_program()
            _place(program, view.view_projection, look.models[0])
            self._bright.draw(program, cull=True)

    def _draw_outline_of_faces(self, targets: Targets, look: Look, faces: np.ndarray) -> None:
        """Draw a line round the visible part of some faces of the static part; a wall has a whole room in front."""
        ctx = self.ctx
        targets.mask.clear()
        self._state()
        ctx.depth_func = "<="
        targets.mask.color_mask = False, False, False, False
        targets.mask.use()
        for o, model in zip(self._objects, look.models, strict=True):
            _place(self._mask, look.view_projection, model)
            o.mark(look.cull)
        targets.mask.color_mask = True, True, True, True
        targets.mask.use()
        _place(self._mask, look.view_projection, look.models[0])
        self._objects[0].mark_faces(faces, look.cull)
        to_clip = look.view_projection @ look.models[0]
        area = self._objects[0].rectangle(to_clip, targets.size, look.outline_width, faces)
        self._draw_line(targets, look, area, (*OUTLINE[:3], look.surface_opacity * OUTLINE[3]))

    def _draw_outline(self, targets: Targets, look: Look, number: int, colour: tuple[float, ...]) -> None:
        """Draw a line round an object, also where others hide it."""
        ctx = self.ctx
        ctx.front_face = "ccw"
        o = self._objects[number]
        model = look.models[number]
        area = o.rectangle(look.view_projection @ model, targets.size, look.outline_width)
        targets.mask.use()
        targets.mask.clear()
        ctx.enable_only(ctx.NOTHING)
        _place(self._mask, look.view_projection, model)
        o.mark()
        self._draw_line(targets, look, area, colour)

    def _draw_line(self, targets: Targets, look: Look, area: tuple[int, int, int, int], colour) -> None:
        """Draw a line round the marked pixels within an area (x, y, width, height)."""
        ctx = self.ctx
        targets.picture.scissor = area  # the filter reads 25 texels per pixel
        targets.picture.use()
        ctx.enable_only(ctx.BLEND)
        ctx.blend_func = ctx.SRC_ALPHA, ctx.ONE_MINUS_SRC_ALPHA, ctx.ZERO, ctx.ONE  # type: ignore[assignment]
        targets.mask.color_attachments[0].use(0)
        program = self._programs.of("screen.vert", "outline.frag")
        put(program, mask=0, line=colour, width=look.outline_width)
        self._programs.cover(program)
        targets.picture.scissor = None

    @property
    def texture(self) -> int:
        """The GL name of the picture; its first row is the bottom one."""
        return self._targets.picture.color_attachments[0].glo

    @property
    def size(self) -> tuple[int, int]:
        return self._targets.size

    @property
    def samples_now(self) -> int:
        return self._targets.samples

    def pixels(self) -> np.ndarray:
        """Read the picture back: (h, w, 3) uint8, top row first."""
        w, h = self._targets.size
        data = self._targets.picture.read(components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(h, w, 3)[::-1]


def _place(program, view_projection: np.ndarray, model: np.ndarray, eye: np.ndarray | None = None) -> None:
    program["view_projection"].write(view_projection.T.astype(np.float32).tobytes())
    program["model"].write(model.T.astype(np.float32).tobytes())
    if eye is not None and "eye" in program:
        program["eye"] = tuple(_in_object(model, eye))


def _in_object(model: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return a point (3,) of the world in the space of an object."""
    return np.asarray(model)[:3, :3].T @ (np.asarray(point) - np.asarray(model)[:3, 3])
