"""Reflections for sharp gloss: the scene reflected in planes, and probes of the surroundings as cube maps.

Images hold linear radiance times exposure, and the distance along the view axis in units of the scene size. A plane
follows the camera in every frame. A probe depends on light and poses alone: it is drawn again where these change and a
picture shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import moderngl
import numpy as np

from app.draw.draw_mesh import DrawMesh
from app.draw.gl_objects import DrawnObject
from app.draw.gl_targets import rectangle
from app.draw.tonemap import BACKGROUND, srgb_decode
from gi_core.gloss.reflectors import OMITTED_INSIDE, PLANAR, PROBE, Reflector
from gi_core.gloss.sharp import TAPS

PLANE_UNIT, PROBE_UNIT = range(2, 4)  # texture units
PROBE_TEXELS = 256  # texels along a face of a probe
PLANES_SHOWN = 4  # per picture, those that cover most; the rest: probes
BACKDROP = 4.0  # of the scene size: distance of the background

# Directions and up vectors of the faces of a cube map, in OpenGL's order.
FACES = (((1, 0, 0), (0, -1, 0)), ((-1, 0, 0), (0, -1, 0)), ((0, 1, 0), (0, 0, 1)),
         ((0, -1, 0), (0, 0, -1)), ((0, 0, 1), (0, -1, 0)), ((0, 0, -1), (0, -1, 0)))  # fmt: skip


class View(NamedTuple):
    """A camera of a reflection."""

    view_projection: np.ndarray  # (4, 4) float64 world to clip
    eye: np.ndarray  # (3,) float64 [m]
    front_face: str
    mirrors: tuple[str, ...]  # ways of sharp gloss that it may show
    gloss: float  # 0: seen from this eye; 1: in a plane, tables as diffuse surfaces; 2: in a probe, all gloss so
    size: tuple[int, int]  # pixels of the image
    skipped: int = -1  # number of the probe whose own faces are left out, -1: none
    compressed: bool = False  # the image holds c / (1 + max c): edges of lamps are then as smooth as in the picture


Shares = dict[tuple[int, int], float]  # by object and its reflector: share of a view that it covers, more than 0
Reflected = dict[int, tuple[View, tuple[int, int, int, int]]]  # by plane: the view in it, and its pixel rectangle


class PlaneFaces(NamedTuple):
    """All faces of a plane."""

    object: int
    equation: np.ndarray  # (4,) float64 in the object's space
    corners: np.ndarray  # (n, 3) float64 there
    one_sided: bool
    blurs: bool  # whether a lobe needs smaller copies of its image


class GLMirrors:
    """Images of the reflections of a scene. `draw` fills them, `use` binds them for a draw call."""

    def __init__(self, ctx: moderngl.Context, meshes: Sequence[DrawMesh]) -> None:
        self._ctx = ctx
        self._of = {(o, k): r for o, mesh in enumerate(meshes) for k, r in enumerate(mesh.reflectors)}
        self.size = max((r.probe.scene_size for r in self._of.values()), default=1.0)
        numbers = sorted({r.plane.number for r in self._of.values() if r.plane is not None})
        self._faces = {number: self._faces_of(number, meshes) for number in numbers}
        self._probes = {r.probe.number: (o, r.probe) for (o, _), r in self._of.items()}
        self._planes: dict[int, _Image] = {}  # of the picture
        self._planes_in_probes: dict[int, _Image] = {}
        self._images = self._planes  # those that are read now
        self._cubes: dict[int, moderngl.TextureCube] = {}
        self._face: _Image | None = None
        self._seen: set[int] = set()  # planes that have an image for this view
        self._keys: dict[int, tuple] = {}  # of the light and the poses in each probe

    def __bool__(self) -> bool:
        return bool(self._of)

    def _faces_of(self, number: int, meshes: Sequence[DrawMesh]) -> PlaneFaces:
        coplanar = [(o, r) for (o, _), r in self._of.items() if r.plane is not None and r.plane.number == number]
        o, first = coplanar[0]
        assert first.plane is not None
        rows = np.unique(meshes[o].triangles[meshes[o].pieces(np.concatenate([r.faces for _, r in coplanar]))])
        corners, is_one_sided = meshes[o].positions[rows].astype(np.float64), bool((meshes[o].back[rows] < 0).all())
        return PlaneFaces(o, first.plane.equation, corners, is_one_sided, _blurs(r for _, r in coplanar))

    def forget(self) -> None:
        """Forget the probes: the light has changed, so the next picture draws those that it shows again."""
        self._keys.clear()

    def draw(
        self,
        draw: Callable[[View], None],
        shares: Callable[[View], Shares],
        picture: View,
        models: Sequence[np.ndarray],
        samples: int,
        key: tuple,
    ) -> None:
        """Draw all reflections that a picture shows.

        draw(view) draws the scene into the bound framebuffer; shares(view): of its reflectors; models (4, 4) per
        object; key: of everything besides light and poses that the images depend on.
        """
        shown = shares(picture)
        planes = self._through(self._chosen(shown, PLANES_SHOWN, 0.002), picture, models, 1.0, (PROBE,))
        needed = {
            r.probe.number for r in map(self._of.__getitem__, shown) if r.plane is None or r.plane.number not in planes
        }
        for view, _ in planes.values():
            needed |= {self._of[which].probe.number for which in shares(view)}
        poses = *key, *(m.tobytes() for m in models)
        for number in sorted(needed):
            if self._keys.get(number) != poses:
                self._keys[number] = poses
                self._draw_probe(number, draw, shares, models)
        self._images = self._planes
        self._draw_planes(planes, draw, samples)

    def _chosen(self, shares: Shares, count: int, least: float) -> list[int]:
        """Return the numbers of the planes that cover most of a view, at most `count`, each at least a share."""
        of: dict[int, float] = {}
        for which, share in shares.items():
            plane = self._of[which].plane
            if plane is not None:
                of[plane.number] = of.get(plane.number, 0.0) + share
        return sorted((n for n in of if of[n] >= least), key=lambda n: -of[n])[:count]

    def _through(self, numbers, view: View, models, gloss: float, mirrors: tuple[str, ...]) -> Reflected:
        """Return the views that planes reflect, and the pixels that they fill."""
        bias = 1e-4  # of the scene size: the reflected scene begins so far in front of its plane
        out = {}
        for number in numbers:
            faces = self._faces[number]
            model = models[faces.object]
            normal = model[:3, :3] @ faces.equation[:3]
            offset = faces.equation[3] + normal @ model[:3, 3]
            height = float(normal @ view.eye - offset)
            corners = faces.corners @ model[:3, :3].T + model[:3, 3]
            area = rectangle(corners, view.view_projection, view.size, 1.0)  # a pixel more: blur reads around
            if area is None or abs(height) < bias * self.size or (faces.one_sided and height < 0):
                continue
            mirror = np.eye(4)
            mirror[:3, :3] -= 2 * np.outer(normal, normal)
            mirror[:3, 3] = 2 * offset * normal
            clip = np.append(normal, -offset) * np.sign(height)
            clip[3] -= bias * self.size
            through = _clipped(view.view_projection @ mirror, clip)
            eye = view.eye - 2 * height * normal
            out[number] = View(through, eye, "cw", mirrors, gloss, view.size, -1, not faces.blurs), area
        return out

    def _draw_planes(self, planes: Reflected, draw: Callable[[View], None], samples: int) -> None:
        self._seen = set()
        for number, (view, area) in planes.items():
            image = self._images.get(number)
            if image is None or (image.size, image.samples) != (view.size, samples):
                image = self._images[number] = _Image(self._ctx, view.size, samples)
            image.begin(area)
            draw(view)
            image.finish(self._faces[number].blurs)
        self._seen = set(planes)

    def _draw_probe(self, number: int, draw: Callable[[View], None], shares, models: Sequence[np.ndarray]) -> None:
        o, probe = self._probes[number]
        if self._face is None:
            self._face = _Image(self._ctx, (PROBE_TEXELS, PROBE_TEXELS), 1)
        turn = models[o][:3, :3]
        centre, half = turn @ probe.centre + models[o][:3, 3], np.abs(turn) @ probe.half
        if number not in self._cubes:
            self._cubes[number] = self._ctx.texture_cube((PROBE_TEXELS, PROBE_TEXELS), 4, dtype="f2")
        cube, blurs = self._cubes[number], _blurs(r for r in self._of.values() if r.probe.number == number)
        cube.filter = _filter(blurs)
        self._images = self._planes_in_probes
        room = self._ctx.buffer(reserve=8 * PROBE_TEXELS * PROBE_TEXELS)
        for face, (forward, up) in enumerate(FACES):
            near = max(OMITTED_INSIDE * float(np.abs(np.array(forward) @ half).max()), 1e-3 * self.size)
            through = _quarter_view(centre, forward, up, near)
            view = View(through, centre, "ccw", (PLANAR,), 2.0, (PROBE_TEXELS, PROBE_TEXELS), number)
            # At most 2 planes per face of a probe, each over at least 0.05 of it.
            chosen = self._chosen(shares(view), 2, 0.05)
            self._draw_planes(self._through(chosen, view, models, 2.0, ()), draw, 1)
            self._face.begin()
            draw(view)
            self._face.texture.read_into(room)
            cube.write(face, room)
        if blurs:
            cube.build_mipmaps()  # half of the time of a software renderer

    def way(self, reflector: Reflector, mirrors: tuple[str, ...]) -> str | None:
        """Return the way in which a view with some `mirrors` shows a reflector; None: there is no image of it."""
        if PLANAR in mirrors and reflector.plane is not None and reflector.plane.number in self._seen:
            return PLANAR
        return PROBE if PROBE in mirrors and reflector.probe.number in self._cubes else None

    def set_up(self, program) -> None:
        """Set the uniforms of a program that all reflectors share."""
        program["plane_image"], program["surroundings"] = PLANE_UNIT, PROBE_UNIT

    def use(self, program, reflector: Reflector, model: np.ndarray, way: str) -> None:
        """Bind the image of a reflector and set the program's uniforms for it."""
        lobe, plane, probe = reflector.lobe, reflector.plane, reflector.probe
        if way == PLANAR:
            assert plane is not None
            image = self._images[plane.number]
            image.texture.use(PLANE_UNIT)
            program["picture"] = tuple(map(float, image.size))
        else:
            self._cubes[probe.number].use(PROBE_UNIT)
            self._ctx.enable_direct(0x884F)  # GL_TEXTURE_CUBE_MAP_SEAMLESS
        program["planar"] = way == PLANAR
        program["compressed"] = way == PLANAR and not self._faces[plane.number].blurs
        program["centre"] = tuple(model[:3, :3] @ probe.centre + model[:3, 3])
        taps = np.zeros((TAPS, 3), np.float32)
        taps[: len(lobe.taps)] = lobe.taps
        program["taps"].write(taps.tobytes())
        program["count"] = len(lobe.taps)
        program["albedo"].write(lobe.albedo.astype(np.float32).tobytes())
        program["lobe"], program["alpha"] = tuple(map(float, lobe.lobe[:4])), float(lobe.lobe[4])


class GLCoverage:
    """Counts in small pictures of depths which share of a view each reflector covers.

    `of` counts, or returns the shares of an earlier call with the same key.
    """

    def __init__(self, ctx: moderngl.Context, samples: int) -> None:
        self._ctx, self._samples = ctx, min(samples, ctx.max_samples)
        self._targets: dict[tuple[int, int], moderngl.Framebuffer] = {}
        self._queries: list[moderngl.Query] = []
        self._known: dict[tuple, Shares] = {}

    def of(
        self,
        key: tuple,
        size: tuple[int, int],
        objects: Mapping[int, DrawnObject],
        place: Callable[[int], None],
        cull: bool,
        omitted: Callable[[Reflector], bool],
    ) -> Shares:
        """Return the shares of a view of `size` (width, height) of some objects; key: all that they depend on.

        place(o) sets up the program of the mask for object o; omitted: reflectors that the view does not show.
        """
        shares = self._known.pop(key, None)
        if shares is None:
            shares = self._counted(size, objects, place, cull, omitted)
        self._known[key] = shares  # the latest comes last
        if len(self._known) > 64:  # 64 views whose shares are kept, those asked for last
            del self._known[next(iter(self._known))]
        return shares

    def forget(self) -> None:
        """Forget the shares of all views: the scene has changed."""
        self._known.clear()

    def _counted(self, size, objects, place, cull, omitted) -> Shares:
        scale = 256 / max(size)  # 256 pixels along the long side of the small picture
        width, height = (max(round(scale * n), 1) for n in size)
        ctx = self._ctx
        target = self._target((width, height))
        target.use()
        target.clear()
        ctx.enable_only(ctx.DEPTH_TEST)
        ctx.depth_func = "<="
        asked: list[tuple[tuple[int, int], moderngl.Query]] = []
        for o, drawn in objects.items():
            place(o)
            drawn.mark(cull, omitted)
        for o, drawn in objects.items():
            for k, reflector in enumerate(drawn.mesh.reflectors):
                if omitted(reflector):
                    continue
                place(o)
                query = self._query(len(asked))
                with query:
                    drawn.mark_reflector(k, cull)
                asked.append(((o, k), query))
        ctx.depth_func = "<"
        whole = width * height * max(target.samples, 1)
        return {which: query.samples / whole for which, query in asked if query.samples}

    def _query(self, n: int) -> moderngl.Query:
        if n == len(self._queries):
            self._queries.append(self._ctx.query(samples=True))
        return self._queries[n]

    def _target(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        if size not in self._targets:
            colour = self._ctx.renderbuffer(size, 1, samples=self._samples)
            depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
            self._targets[size] = self._ctx.framebuffer([colour], depth)
        return self._targets[size]


class _Image:
    """A texture of half floats that can be drawn to, multisampled."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self.size, self.samples, self._ctx = size, samples, ctx
        self.texture = ctx.texture(size, 4, dtype="f2")
        self.texture.repeat_x = self.texture.repeat_y = False
        depth = ctx.depth_renderbuffer(size, samples=samples if samples > 1 else 0)
        if samples > 1:
            colour = ctx.renderbuffer(size, 4, samples=samples, dtype="f2")
            self.shown, self._drawn = ctx.framebuffer([self.texture]), ctx.framebuffer([colour], depth)
        else:
            self.shown = self._drawn = ctx.framebuffer([self.texture], depth)

    def begin(self, area: tuple[int, int, int, int] | None = None) -> None:
        """Bind and clear the part (x, y, width, height) in pixels; None: all."""
        self._drawn.use()
        self._drawn.scissor = area
        r, g, b = srgb_decode(np.array(BACKGROUND))
        self._drawn.clear(r, g, b, BACKDROP)

    def finish(self, blurred: bool) -> None:
        """Resolve the samples; blurred: make smaller copies."""
        self._drawn.scissor = None
        if self._drawn is not self.shown:
            self._ctx.copy_framebuffer(self.shown, self._drawn)
        self.texture.filter = _filter(blurred)
        if blurred:
            self.texture.build_mipmaps()


def _blurs(reflectors: Iterable[Reflector]) -> bool:
    """Return whether any lobe needs smaller copies of its image."""
    return any(len(r.lobe.taps) > 1 for r in reflectors)


def _filter(blurred: bool) -> tuple[int, int]:
    return (moderngl.LINEAR_MIPMAP_LINEAR if blurred else moderngl.LINEAR), moderngl.LINEAR


def _clipped(to_clip: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return a matrix to clip space whose near plane is a plane (4,) of the world (Lengyel 2005).

    The far plane moves away from the eye: reflected paths are at most three times as long as those of the picture.
    """
    inverse = np.linalg.inv(to_clip)
    side = plane @ inverse
    corner = inverse @ np.array([np.sign(side[0]), np.sign(side[1]), 1.0, 1.0])
    rows = to_clip[[0, 1, 3]]  # x, y and w: 0 at the eye, where all rays meet
    eye = np.append(np.linalg.solve(rows[:, :3], -rows[:, 3]), 1.0)
    corner += 3 * (corner - corner[3] * eye)
    out = to_clip.copy()
    out[2] = 2 * (to_clip[3] @ corner) / (plane @ corner) * plane - to_clip[3]
    return out


def _quarter_view(centre: np.ndarray, forward, up, near: float) -> np.ndarray:
    """Return the matrix (4, 4) to clip space of a face of a probe, which sees everything beyond its near plane."""
    f, u = np.array(forward, np.float64), np.array(up, np.float64)
    view = np.eye(4)
    view[:3, :3] = np.stack([np.cross(f, u), u, -f])
    view[:3, 3] = -view[:3, :3] @ centre
    projection = np.diag([1.0, 1.0, -1.0, 0.0])
    projection[2, 3], projection[3, 2] = -2 * near, -1.0
    return projection @ view
