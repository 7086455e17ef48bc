"""Handles over the selected objects: arrows that move them, rings that turn them (ImGuizmo)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui, imguizmo

from app.draw.false_colour import round_below
from gi_core.scene import Pose
from gi_core.scene.pose import as_pose, carried, rotation, three

if TYPE_CHECKING:
    from app.draw.camera import Bounds
    from app.session.session import Session
    from app.window.camera_control import View

G = imguizmo.im_guizmo
MOVE, TURN = "move", "turn"
MODES = ("", MOVE, TURN)  # in the order of the key
OPERATIONS = {MOVE: G.OPERATION.translate, TURN: G.OPERATION.rotate}


class Gizmo:
    """`draw` once per frame, after the picture, while it has a mode or is shown."""

    def __init__(self) -> None:
        self.mode = ""  # one of MODES
        self.snaps = False  # also while Ctrl is held
        self._held = False
        self.is_shown = False
        self._middle = np.zeros(3)  # of the objects that are held

    def next_mode(self) -> None:
        self.mode = MODES[(MODES.index(self.mode) + 1) % len(MODES)]

    @property
    def takes_mouse(self) -> bool:
        """Whether the mouse is over a handle, or holds one."""
        return self.is_shown and (G.is_over() or G.is_using())

    def draw(self, session: Session, view: View, names: tuple[str, ...], room: Bounds) -> None:
        """Draw the handles of objects that move as one; move them inside a box when they are dragged."""
        self.is_shown = bool(self.mode) and bool(names)
        if not self.is_shown:
            self._end(session)
            return
        name = names[-1]
        poses = session.poses if self._held else session.light.snapshot.poses  # those of the picture
        pose, origin = poses[name], session.model.origins[0]
        middle = np.mean(session.box_of(names, poses), axis=0) if not self._held else self._middle
        at = np.eye(4)
        at[:3, :3], at[:3, 3] = rotation(pose), middle - origin
        G.begin_frame()
        G.allow_axis_flip(False)
        G.set_drawlist(imgui.get_window_draw_list())
        G.set_rect(*view.origin, *view.size)
        G.set_gizmo_size_clip_space(8 * imgui.get_font_size() / view.size[0])  # arrows of 4 em
        matrix = _matrix(at)
        camera = view.camera.relative_to(origin)
        eye, projection = _matrix(camera.view()), _matrix(camera.projection(view.aspect))
        snap = self._snap(session.chosen.scene_size)
        changed = G.manipulate(eye, projection, OPERATIONS[self.mode], G.MODE.world, matrix, None, snap)
        if G.is_using() and not self._held:
            self._held, self._middle = True, middle
            session.motion.playing = False
            session.begin_drag()
        if changed and self._held:
            moved = np.array(matrix.values, np.float64).reshape(4, 4).T
            to = moved[:3, 3] + origin
            to = np.clip(to, np.minimum(room.low, self._middle), np.maximum(room.high, self._middle))
            after = moved_pose(pose, middle, to, moved[:3, :3] if self.mode == TURN else None)
            self._middle = to
            if after != session.poses[name]:
                session.move({**carried({other: poses[other] for other in names}, pose, after), name: after})
        if not G.is_using():
            self._end(session)

    def _end(self, session: Session) -> None:
        if self._held:
            self._held = False
            session.end_drag()

    def _snap(self, size: float):
        if not (self.snaps or imgui.get_io().key_ctrl):
            return None
        step = round_below(0.01 * size) if self.mode == MOVE else 15.0  # degrees
        return G.Matrix3([step] * 3)


def moved_pose(pose: Pose, middle: np.ndarray, to: np.ndarray, turned: np.ndarray | None) -> Pose:
    """Return a pose moved so that the point `middle` (3,) [m] comes to `to`; turned (3, 3): its new rotation, if any.

    A matrix of float32 is rounded to the nearest rotation.
    """
    from_middle = np.array(pose.position) - middle
    if turned is None:
        return pose._replace(position=three(to + from_middle))
    u, _, v = np.linalg.svd(np.asarray(turned, np.float64))
    out = np.eye(4)
    out[:3, :3] = u @ v
    out[:3, 3] = to + u @ v @ rotation(pose).T @ from_middle
    return as_pose(out)


def _matrix(M: np.ndarray):
    return G.Matrix16(M.T.reshape(-1).astype(float).tolist())
