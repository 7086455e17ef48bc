"""Reflections for sharp gloss: the scene reflected in planes, and probes of the surroundings as cube maps.

Images hold linear radiance times exposure, and the distance along the view axis in units of the scene size. A plane
follows the camera in every frame. A probe depends on light and poses alone: it is drawn again where these change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import moderngl
import numpy as np

from app.draw.tonemap import srgb_decode
from app.draw.unlit import BACKGROUND
from gi_core.gloss.sharp import PLANAR, PROBE, TAPS, Reflector

if TYPE_CHECKING:
    from app.draw.draw_mesh import DrawMesh

PLANE_UNIT, PROBE_UNIT = 2, 3  # texture units
SIDE = 256  # texels along a face of a probe
BIAS = 1e-4  # of the scene size: the reflected scene begins so far in front of its plane
INSIDE = 0.6  # of the box of a probe's faces: what is nearer to its centre is left out. A ball hides no more than 0.58
NEAR, FAR = 1e-3, 4.0  # of the scene size: clip planes of probes, and the distance of the background
SEAMLESS = 0x884F  # GL_TEXTURE_CUBE_MAP_SEAMLESS

# Directions and up vectors of the faces of a cube map, in OpenGL's order.
FACES = (((1, 0, 0), (0, -1, 0)), ((-1, 0, 0), (0, -1, 0)), ((0, 1, 0), (0, 0, 1)),
         ((0, -1, 0), (0, 0, -1)), ((0, 0, 1), (0, -1, 0)), ((0, 0, -1), (0, -1, 0)))  # fmt: skip


class View(NamedTuple):
    """A camera of a reflection."""

    view_projection: np.ndarray  # (4, 4) float64 world to clip
    eye: np.ndarray  # (3,) float64 [m]
    front_face: str
    mirrors: tuple[str, ...]  # ways of sharp gloss that are shown in it
    gloss: float  # 0: seen from this eye; 1: in a plane, tables as diffuse surfaces; 2: in a probe, all gloss so
    size: tuple[int, int]  # pixels of the image
    skipped: int = -1  # number of the probe whose own faces are left out, -1: none
    compressed: bool = False  # the image holds c / (1 + max c): edges of lamps are then as smooth as in the picture


class Placed(NamedTuple):
    """A reflector of an object."""

    object: int
    reflector: Reflector
    corners: np.ndarray  # (n, 3) float64 of its faces, object space
    one_sided: bool

    def shows_probe(self, number: int) -> bool:
        return self.reflector.way != PLANAR and self.reflector.number == number

    def shows_plane(self, number: int) -> bool:
        return self.reflector.way == PLANAR and self.reflector.number == number


class GLMirrors:
    """Images of the reflections of a scene. `draw` fills them, `use` binds them for a draw call."""

    def __init__(self, ctx: moderngl.Context, meshes: Sequence[DrawMesh]) -> None:
        self._ctx = ctx
        self._placed = [_placed(o, mesh, r) for o, mesh in enumerate(meshes) for r in mesh.reflectors]
        boxes = [mesh.positions for mesh in meshes if len(mesh.positions)]
        self.size = max((float(np.ptp(p, axis=0).max()) for p in boxes), default=1.0)
        self._planes: dict[int, _Image] = {}  # of the picture
        self._planes_in_probes: dict[int, _Image] = {}
        self._images = self._planes  # those that are read now
        self._cubes: dict[int, moderngl.TextureCube] = {}
        self._face: _Image | None = None
        self._seen: set[int] = set()  # planes that have an image for this view
        self._key: tuple | None = None  # of the light and the poses in the probes

    def __bool__(self) -> bool:
        return bool(self._placed)

    def forget(self) -> None:
        """Forget the probes: the light has changed, so the next picture draws them again."""
        self._key = None

    def draw(
        self,
        draw: Callable[[View], None],
        view_projection: np.ndarray,
        eye: np.ndarray,
        models: Sequence[np.ndarray],
        size: tuple[int, int],
        samples: int,
        key: tuple,
    ) -> None:
        """Draw all reflections that the picture may show.

        draw(view) draws the scene into the bound framebuffer; models (4, 4) per object; key: of everything besides
        light and poses that the images depend on.
        """
        self._draw_probes(draw, models, (*key, *(m.tobytes() for m in models)))
        self._images = self._planes
        self._draw_planes(draw, View(view_projection, eye, "cw", (PROBE,), 1.0, size), models, size, samples)

    def _draw_probes(self, draw: Callable[[View], None], models: Sequence[np.ndarray], key: tuple) -> None:
        probes = {p.reflector.number: p for p in self._placed if p.reflector.way != PLANAR}
        if not probes or key == self._key:
            return
        self._key = key
        if self._face is None:
            self._face = _Image(self._ctx, (SIDE, SIDE), 1)
        room = self._ctx.buffer(reserve=8 * SIDE * SIDE)
        for number, p in probes.items():
            turn = models[p.object][:3, :3]
            centre, half = turn @ p.reflector.centre + models[p.object][:3, 3], np.diag(_half_box(p.reflector, turn))
            if number not in self._cubes:
                self._cubes[number] = self._ctx.texture_cube((SIDE, SIDE), 4, dtype="f2")
            cube, blurs = self._cubes[number], _blurs(q.reflector for q in self._placed if q.shows_probe(number))
            cube.filter = _filter(blurs)
            for face, (forward, up) in enumerate(FACES):
                near = INSIDE * float(np.abs(np.array(forward) @ half).max())
                view = _quarter_view(centre, forward, up, max(near, NEAR * self.size), 2 * FAR * self.size)
                self._images = self._planes_in_probes
                self._draw_planes(draw, View(view, centre, "cw", (), 2.0, (SIDE, SIDE)), models, (SIDE, SIDE), 1)
                self._face.begin()
                draw(View(view, centre, "ccw", (PLANAR,), 2.0, (SIDE, SIDE), number))
                self._face.texture.read_into(room)
                cube.write(face, room)
            if blurs:
                cube.build_mipmaps()  # half of the time of a software renderer
        room.release()

    def _draw_planes(self, draw, behind: View, models: Sequence[np.ndarray], size: tuple[int, int], samples: int):
        """Draw the images of all planes that a view shows; behind: how it shows what lies behind a plane."""
        self._seen = set()
        for p in self._placed:
            if p.reflector.way == PLANAR and p.reflector.number not in self._seen:
                self._draw_plane(p, draw, behind, models[p.object], size, samples)

    def _draw_plane(self, p: Placed, draw, behind: View, model: np.ndarray, size: tuple[int, int], samples: int):
        normal, eye = model[:3, :3] @ p.reflector.plane[:3], behind.eye
        offset = p.reflector.plane[3] + normal @ model[:3, 3]
        height = float(normal @ eye - offset)
        corners = p.corners @ model[:3, :3].T + model[:3, 3]
        area = _rectangle(corners, behind.view_projection, size)
        if area is None or abs(height) < BIAS * self.size or (p.one_sided and height < 0):
            return
        number = p.reflector.number
        self._seen.add(number)
        image = self._images.get(number)
        if image is None or (image.size, image.samples) != (size, samples):
            if image is not None:
                image.release()
            image = self._images[number] = _Image(self._ctx, size, samples)
        mirror = np.eye(4)
        mirror[:3, :3] -= 2 * np.outer(normal, normal)
        mirror[:3, 3] = 2 * offset * normal
        clip = np.append(normal, -offset) * np.sign(height)
        clip[3] -= BIAS * self.size
        image.begin(area)
        blurs = _blurs(q.reflector for q in self._placed if q.shows_plane(number))
        through = _clipped(behind.view_projection @ mirror, clip)
        draw(behind._replace(view_projection=through, eye=eye - 2 * height * normal, compressed=not blurs))
        image.finish(blurs)

    def shows(self, reflector: Reflector) -> bool:
        """Return whether there is an image for a reflector."""
        if reflector.way == PLANAR:
            return reflector.number in self._seen
        return reflector.number in self._cubes

    def set_up(self, program) -> None:
        """Set the uniforms of a program that all reflectors share."""
        program["plane_image"], program["surroundings"] = PLANE_UNIT, PROBE_UNIT

    def use(self, program, reflector: Reflector, model: np.ndarray) -> None:
        """Bind the image of a reflector and set the program's uniforms for it."""
        planar, lobe = reflector.way == PLANAR, reflector.lobe
        if planar:
            image = self._images[reflector.number]
            image.texture.use(PLANE_UNIT)
            program["picture"] = tuple(map(float, image.size))
        else:
            self._cubes[reflector.number].use(PROBE_UNIT)
            self._ctx.enable_direct(SEAMLESS)
        program["planar"] = planar
        program["compressed"] = planar and not _blurs(
            q.reflector for q in self._placed if q.shows_plane(reflector.number)
        )
        program["centre"] = tuple(model[:3, :3] @ reflector.centre + model[:3, 3])
        taps = np.zeros((TAPS, 3), np.float32)
        taps[: len(lobe.taps)] = lobe.taps
        program["taps"].write(taps.tobytes())
        program["count"] = len(lobe.taps)
        program["albedo"].write(lobe.albedo.astype(np.float32).tobytes())
        program["lobe"], program["alpha"] = tuple(map(float, lobe.lobe[:4])), float(lobe.lobe[4])

    def release(self) -> None:
        planes = *self._planes.values(), *self._planes_in_probes.values()
        for image in (*planes, *([] if self._face is None else [self._face])):
            image.release()
        for cube in self._cubes.values():
            cube.release()
        self._planes, self._planes_in_probes, self._cubes, self._face, self._key = {}, {}, {}, None, None


class _Image:
    """A texture of half floats that can be drawn to, multisampled."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self.size, self.samples, self._ctx = size, samples, ctx
        self.texture = ctx.texture(size, 4, dtype="f2")
        self.texture.repeat_x = self.texture.repeat_y = False
        depth = ctx.depth_renderbuffer(size, samples=samples if samples > 1 else 0)
        self._owned: list[moderngl.Texture | moderngl.Renderbuffer] = [self.texture, depth]
        if samples > 1:
            colour = ctx.renderbuffer(size, 4, samples=samples, dtype="f2")
            self._owned.append(colour)
            self.shown, self._drawn = ctx.framebuffer([self.texture]), ctx.framebuffer([colour], depth)
        else:
            self.shown = self._drawn = ctx.framebuffer([self.texture], depth)

    def begin(self, area: tuple[int, int, int, int] | None = None) -> None:
        """Bind and clear the part (x, y, width, height) in pixels; None: all."""
        self._drawn.use()
        self._drawn.scissor = area
        r, g, b = srgb_decode(np.array(BACKGROUND))
        self._drawn.clear(r, g, b, FAR)

    def finish(self, blurred: bool) -> None:
        """Resolve the samples; blurred: make smaller copies."""
        self._drawn.scissor = None
        if self._drawn is not self.shown:
            self._ctx.copy_framebuffer(self.shown, self._drawn)
        self.texture.filter = _filter(blurred)
        if blurred:
            self.texture.build_mipmaps()

    def release(self) -> None:
        if self._drawn is not self.shown:
            self._drawn.release()
        self.shown.release()
        for thing in self._owned:
            thing.release()


def _blurs(reflectors: Iterable[Reflector]) -> bool:
    """Return whether any lobe needs smaller copies of its image."""
    return any(len(r.lobe.taps) > 1 for r in reflectors)


def _filter(blurred: bool) -> tuple[int, int]:
    return (moderngl.LINEAR_MIPMAP_LINEAR if blurred else moderngl.LINEAR), moderngl.LINEAR


def _placed(o: int, mesh: DrawMesh, r: Reflector) -> Placed:
    rows = mesh.triangles[r.faces].reshape(-1)
    return Placed(o, r, mesh.positions[np.unique(rows)].astype(np.float64), bool((mesh.back[rows] < 0).all()))


def _rectangle(corners: np.ndarray, to_clip: np.ndarray, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """Return the pixel rectangle (x, y, width, height) of points (n, 3); None: out of sight."""
    clip = np.c_[corners, np.ones(len(corners))] @ to_clip.T
    for axis in range(3):
        if (clip[:, axis] < -clip[:, 3]).all() or (clip[:, axis] > clip[:, 3]).all():
            return None
    if clip[:, 3].min() <= 1e-6 * np.abs(clip).max():
        return 0, 0, *size  # it reaches behind the eye
    at = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
    # A pixel more: blur reads around.
    low = np.clip(np.floor(at.min(axis=0)) - 1, 0, size).astype(int)
    high = np.clip(np.ceil(at.max(axis=0)) + 1, 0, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _clipped(to_clip: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return a matrix to clip space whose near plane is a plane (4,) of the world (Lengyel 2005).

    The far plane moves away from the eye: reflected paths are at most three times as long as those of the picture.
    """
    inverse = np.linalg.inv(to_clip)
    side = plane @ inverse
    corner = inverse @ np.array([np.sign(side[0]), np.sign(side[1]), 1.0, 1.0])
    corner += 3 * (corner - corner[3] * _eye_of(to_clip))
    out = to_clip.copy()
    out[2] = 2 * (to_clip[3] @ corner) / (plane @ corner) * plane - to_clip[3]
    return out


def _eye_of(to_clip: np.ndarray) -> np.ndarray:
    """Return the point (4,) in which all rays of a perspective view meet: x, y and w are 0 there."""
    point = np.linalg.solve(to_clip[[0, 1, 3], :3], -to_clip[[0, 1, 3], 3])
    return np.append(point, 1.0)


def _half_box(reflector: Reflector, turn: np.ndarray) -> np.ndarray:
    """Return half of the sides (3,) of the box around the turned box of a reflector."""
    return np.abs(turn) @ (reflector.box[1] - reflector.box[0]) / 2


def _quarter_view(centre: np.ndarray, forward, up, near: float, far: float) -> np.ndarray:
    """Return the matrix (4, 4) to clip space of a face of a probe."""
    f, u = np.array(forward, np.float64), np.array(up, np.float64)
    view = np.eye(4)
    view[:3, :3] = np.stack([np.cross(f, u), u, -f])
    view[:3, 3] = -view[:3, :3] @ centre
    projection = np.diag([1.0, 1.0, (far + near) / (near - far), 0.0])
    projection[2, 3], projection[3, 2] = 2 * far * near / (near - far), -1.0
    return projection @ view
