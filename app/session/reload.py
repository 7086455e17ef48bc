"""Reloads of the current scene, and scenes dropped on the window.

The current scene stays in use while the new one opens, and remains if that fails.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from app.cli import saved_scene
from app.session.session import Session
from app.settings import Settings

# Settings that a new scene resets; display and estimator settings stay.
OF_A_SCENE = (
    "document", "camera", "max_edge", "up", "allow_outside", "photons", "radius", "neighbours", "poses", "exposure",
    "lamps", "solo", "light_scenes", "pins", "plane",
)  # fmt: skip


class Reload:
    """`again` and `other` start to open a scene; `tick`, once per frame, returns its session once it is ready."""

    def __init__(self, open_with: Callable) -> None:
        self.coming: Session | None = None  # the session being opened
        self.same = False  # the new scene is the current one, reloaded
        self.problem = ""  # error of the last scene that failed to open
        self._open_with = open_with
        self._before = Settings()  # of the current session, at the start of the reload

    def again(self, now: Session) -> None:
        """Reload the current scene; the user's settings and poses stay."""
        self._begin(now, settings_again(now), same=True)

    def other(self, now: Session, files: Sequence[str]) -> None:
        """Open another scene: of several files the first .toml, else the first; the others become mobiles."""
        scene = next((f for f in files if Path(f).suffix.lower() == ".toml"), files[0])
        try:
            settings = settings_for(now, scene, tuple(f for f in files if f != scene))
        except Exception as problem:  # of a saved scene
            self.problem = f"{problem}"
            raise
        self._begin(now, settings, same=False)

    def _begin(self, now: Session, settings: Settings, same: bool) -> None:
        self.close()
        self.same, self.problem, self._before = same, "", now.settings
        self.coming = Session(settings, now.log, self._open_with)

    @property
    def progress(self) -> tuple[str, float | None] | None:
        """Phase and fraction of the opening; None without one."""
        if self.coming is None:
            return None
        return ("ready", 1.0) if self.coming.opening is None else self.coming.opening.progress

    def tick(self, now: Session) -> Session | None:
        """Return the new session to show; None before it is ready and during a drag."""
        coming = self.coming
        if coming is None:
            return None
        if not coming.ready:
            coming.tick(0.0, budget=0.0)
            if coming.problem is not None:
                self.problem, self.coming = f"{coming.problem}", None
            return None
        coming.light.move_pending(0.0)
        if coming.light.is_moving or now.dragging or self._moves(now, coming):
            return None
        self._take_over(now, coming)
        self.coming = None
        return coming

    def _moves(self, now: Session, coming: Session) -> bool:
        """Move the new session's mobiles to the current poses; False: nothing to move, or it failed."""
        if not self.same or coming.light.move_failed:
            return False
        kept = {name: p for name, p in now.moved.items() if coming.poses.get(name, p) != p}
        if kept:
            coming.move(kept)
        return bool(kept)

    def _take_over(self, now: Session, coming: Session) -> None:
        """Copy the settings that the user has changed since the start of the reload."""
        before, theirs = vars(self._before), () if self.same else OF_A_SCENE
        changed = {name: v for name, v in vars(now.settings).items() if v != before[name] and name not in theirs}
        coming.lights = now.lights
        coming.want(replace(coming.settings, **changed))

    def close(self) -> None:
        """Cancel the opening."""
        if self.coming is not None:
            self.coming.close(0.0)
            self.coming = None


def settings_again(now: Session) -> Settings:
    """Return settings for a reload; settings that the program filled in become None."""
    chosen = {name: None for name, value in now.filled.items() if getattr(now.settings, name) == value}
    return replace(now.settings, **chosen, poses=())


def settings_for(now: Session, scene: str, mobiles: tuple[str, ...]) -> Settings:
    """Return settings for another scene; those of OF_A_SCENE become None. Raises SceneError for a bad saved scene.

    A saved scene gives all its settings; others that were not changed then have their defaults again.
    """
    saved = saved_scene.opened(Settings(scene=scene))
    if saved.document:
        fields = ("document", "scene", *saved_scene.ELSEWHERE, *saved_scene.WITHOUT_OPTION, *saved_scene.SAVED)
        of_file = {name: getattr(saved, name) for name in fields}
        return replace(now.settings, **(of_file | {"mobiles": (*saved.mobiles, *mobiles), "solo": ""}))
    left_open = {name: getattr(Settings, name) for name in OF_A_SCENE}
    return replace(settings_again(now), **left_open, scene=scene, mobiles=mobiles)
