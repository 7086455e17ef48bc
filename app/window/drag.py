"""Drags on mobiles: cursor rays in, poses out. Pure functions, no window.

The press fixes the mode and the grabbed point. In each frame the cursor's ray gives a target for that point. It is
computed from the press alone, so a cursor that returns to the press restores the pose exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imgui_bundle import imgui

from app.draw.camera import Bounds, Turntable
from app.draw.picking import Hit
from app.session.session import Session
from app.window.camera_control import CLICK_PIXELS, View
from gi_core.base.vectors import frame_of
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, carried, four, multiply_quaternions, three, to_millionths

SLIDE, RAISE, FACE, TURN = "slide", "raise", "face", "turn"
MODES = {
    SLIDE: "slides at constant height",
    RAISE: "moves up and down",
    FACE: "moves in the image plane",
    TURN: "turns about the vertical",
}
TURN_SPEED = 360.0  # degrees per picture height
PARALLEL_COSINE = 1e-4  # |cos| of ray and plane; below it the hit lies outside any scene
LEAST_SLOPE = 0.1  # sine of ray and plane; below it a slide follows the image plane: 180 pixels threw a drawer by 23 m


class Grab(NamedTuple):
    """State of a drag at the press."""

    mobile: str
    mode: str
    point: np.ndarray  # (3,) hit of the cursor's ray on the mobile [m]
    pose: Pose  # of the mobile
    camera: Turntable
    u: float  # the cursor in the picture, (0, 0) top left, (1, 1) bottom right
    v: float
    low: np.ndarray  # (3,) box in the world, at the press, of all mobiles that move
    high: np.ndarray
    pivot: np.ndarray | None = None  # (3,) of a turn [m]; None: the mobile's own position


def room_for(bounds: Bounds, lit: Bounds, up) -> Bounds:
    """Return the drag box: the scene's box within half of the lit part's diagonal about that, and at least as high.

    Something far away in the file, or a wide ground, does not let an object go there.
    """
    up, around = frame_of(up)[2], lit.radius
    low, high = (np.clip(p, np.subtract(lit.low, around), np.add(lit.high, around)) for p in (bounds.low, bounds.high))
    missing = max(around - float(np.abs(up) @ (high - low)), 0.0)
    low, high = low + np.minimum(up, 0) * missing, high + np.maximum(up, 0) * missing
    return Bounds(three(low), three(high))


def mode_of(shift: bool, alt: bool, ctrl: bool) -> str:
    """Return the mode that the modifier keys choose."""
    return RAISE if shift else FACE if alt else TURN if ctrl else SLIDE


def dragged(grab: Grab, u: float, v: float, aspect: float, bounds: Bounds) -> Pose:
    """Return the pose for the cursor at (u, v); the mobile stays inside the bounds."""
    if grab.mode == TURN:
        q = axis_angle(grab.camera.up, (u - grab.u) * aspect * TURN_SPEED)
        turned = np.array(multiply_quaternions(q, grab.pose.quaternion))
        pose = grab.pose._replace(quaternion=four(turned / np.linalg.norm(turned)))
        if grab.pivot is None:
            return pose
        about = Pose(three(grab.pivot))
        return carried({"": grab.pose}, about, about._replace(quaternion=q))[""]
    if (u, v) == (grab.u, grab.v):
        return grab.pose
    target = _TARGETS[grab.mode](grab, u, v, aspect, bounds)
    shift = np.clip(target, *_room(grab, bounds)) - grab.point
    size = float(np.max(np.subtract(bounds.high, bounds.low)))
    return grab.pose._replace(position=three(to_millionths(np.array(grab.pose.position) + shift, size)))


def on_plane(origin, direction, point, normal) -> np.ndarray | None:
    """Return the hit (3,) of a ray on a plane; None for a grazing ray or a plane behind the origin."""
    cosine = float(direction @ normal)
    if abs(cosine) < PARALLEL_COSINE:
        return None
    t = float((point - origin) @ normal) / cosine
    return origin + t * direction if t > 0 else None


def _slide(grab: Grab, u: float, v: float, aspect: float, bounds: Bounds) -> np.ndarray:
    """Return the point (3,) at constant height; near the horizon it moves as far as in the image plane."""
    origin, direction = grab.camera.ray(u, v, aspect)
    up = frame_of(grab.camera.up)[2]
    level = direction - (direction @ up) * up
    foot = origin + float((grab.point - origin) @ up) * up  # below or above the eye, at the point's height
    length = float(np.linalg.norm(level))
    if length < PARALLEL_COSINE:
        return foot
    level = level / length
    low, high = _room(grab, bounds)
    s = _distance(float((grab.point - origin) @ up), float(np.linalg.norm(grab.point - origin)), float(direction @ up))
    # Clip the far end on the track: clipping a far point axis by axis would slide it along a wall into a corner. Of the
    # near end it would push a wide group, whose room is small and may begin behind the eye's foot, away from the eye.
    leave = _end_in_box(foot, level, low, high)
    if leave is None:
        s = min(s, 2 * bounds.radius + float(np.linalg.norm(grab.point - foot)))
    else:
        s = min(s, leave)
    target = foot + s * level
    return target + float((grab.point - target) @ up) * up  # the height exactly as it was


def _distance(height: float, depth: float, slope: float) -> float:
    """Return the horizontal distance [m] at which a ray meets a horizontal plane.

    height, depth: of the grabbed point over the eye and from it [m]; slope: sine of the ray over the horizontal. A ray
    flatter than LEAST_SLOPE, and than that to the point, goes on by its angle times the distance there.
    """
    side = np.sign(height) or -1.0
    angle, flat = np.arcsin(side * slope), np.arcsin(min(LEAST_SLOPE, abs(height) / max(depth, 1e-300), 1.0))
    if angle > flat:
        return float(abs(height) / np.tan(angle))
    limit = abs(height) / np.tan(flat) if flat > 0 else depth
    return float(limit * (1 + flat - angle))


def _raise(grab: Grab, u: float, v: float, aspect: float, bounds: Bounds) -> np.ndarray:
    """Move along the vertical through the point, on the upright plane that faces the eye."""
    up = frame_of(grab.camera.up)[2]
    _, upward, forward = grab.camera.basis()
    normal = forward - (forward @ up) * up
    steep = float(np.linalg.norm(normal))
    if steep >= 0.25:  # below a sine of 0.25 of view and vertical, a vertical drag is measured in the picture
        hit = on_plane(*grab.camera.ray(u, v, aspect), grab.point, normal / steep)
        if hit is not None:
            return grab.point + float((hit - grab.point) @ up) * up
        return grab.point + np.sign(grab.v - v) * 2 * bounds.radius * up
    # From straight above no ray has a height: the drag counts in picture heights at the point's depth.
    depth = float((grab.point - grab.camera.eye()) @ forward)
    return grab.point + (grab.v - v) * 2 * depth * np.tan(grab.camera.fov / 2) * up


def _face(grab: Grab, u: float, v: float, aspect: float, bounds: Bounds) -> np.ndarray:
    forward = grab.camera.basis()[2]
    hit = on_plane(*grab.camera.ray(u, v, aspect), grab.point, forward)
    return grab.point if hit is None else hit


_TARGETS = {SLIDE: _slide, RAISE: _raise, FACE: _face}


def _room(grab: Grab, bounds: Bounds) -> tuple[np.ndarray, np.ndarray]:
    """Return the box of the point that keeps the mobile in bounds, extended to its present position."""
    low = np.array(bounds.low) + (grab.point - grab.low)
    high = np.array(bounds.high) - (grab.high - grab.point)
    return np.minimum(low, grab.point), np.maximum(high, grab.point)


def _end_in_box(origin, direction, low, high) -> float | None:
    """Return the distance at which a ray leaves a box, None for a miss."""
    entry, leave = 0.0, np.inf
    for k in range(3):
        if abs(direction[k]) < 1e-12:
            if not low[k] - 1e-9 <= origin[k] <= high[k] + 1e-9:
                return None
            continue
        a, b = sorted(((low[k] - origin[k]) / direction[k], (high[k] - origin[k]) / direction[k]))
        entry, leave = max(entry, a), min(leave, b)
    return leave if entry <= leave else None


LEFT, RIGHT, MIDDLE = range(3)  # mouse buttons


class MobileDrag:
    """`begin` at a press, `follow` in each frame after it; `room`: box that mobiles stay in."""

    def __init__(self, room: Bounds | None = None) -> None:
        self.room = room
        self.grab: Grab | None = None  # None: nothing is dragged
        self.companions: dict[str, Pose] = {}  # poses at the press of mobiles that move with the grabbed one

    def begin(self, session: Session, view: View, hit: Hit, mode: str, names: tuple[str, ...] = ()) -> None:
        """Grab a mobile where the cursor meets it; names: mobiles that move as one, the grabbed one among them."""
        mobile = session.scene.mobiles[hit.object - 1].name
        self.companions = {name: session.poses[name] for name in names if name != mobile}
        u, v = view.uv(imgui.get_io().mouse_pos)
        session.motion.playing = False
        session.begin_drag()
        low, high = session.box_of((mobile, *self.companions))
        pivot = (low + high) / 2 if self.companions else None
        self.grab = Grab(mobile, mode, hit.point, session.poses[mobile], view.camera, u, v, low, high, pivot)

    def follow(self, session: Session, view: View) -> None:
        """Move the mobiles to the cursor; end when the button is released."""
        u, v = view.uv(imgui.get_io().mouse_pos)
        way = math.hypot((u - self.grab.u) * view.size[0], (v - self.grab.v) * view.size[1])
        # A cursor that leaves the window has no place for a moment.
        if imgui.is_mouse_pos_valid() and (way >= CLICK_PIXELS or session.poses != session.motion.before):
            # The camera may have dollied since the press: the ray is of the current camera.
            grab = self.grab._replace(camera=view.camera)
            pose = dragged(grab, u, v, view.aspect, self.room)
            if pose != session.poses[grab.mobile]:
                session.move({grab.mobile: pose, **carried(self.companions, grab.pose, pose)})
        if not (imgui.is_mouse_down(LEFT) or imgui.is_mouse_down(RIGHT)):
            self.grab = None
            session.end_drag()

    def cancel(self, session: Session) -> bool:
        """Restore the poses; return False without a drag."""
        if self.grab is None:
            return False
        self.grab = None
        session.end_drag(keep=False)
        return True
