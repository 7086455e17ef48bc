"""A scene that is to take the place of the one on show: the same loaded again, or another one dropped on the window.

It is opened beside the one on show, which goes on meanwhile and stays where the other cannot be opened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from app.session.session import Session
from app.settings import Settings

# What depends on the scene; how to look at it, and what the user wants of estimators, does not.
OF_A_SCENE = ("max_edge", "up", "allow_outside", "photons", "radius", "neighbours", "poses", "exposure")


class Reload:
    """`again` and `other` begin to open a scene; `tick`, once a frame, returns its session as soon as it is ready."""

    def __init__(self, open_with: Callable) -> None:
        self.coming: Session | None = None  # what is being opened
        self.same = False  # it is the scene on show, loaded again
        self.problem = ""  # why the last one could not be opened
        self._open_with = open_with
        self._before = Settings()  # of the one on show, when it began

    def again(self, now: Session) -> None:
        """Load the scene on show once more: what the user has set and moved stays."""
        self._begin(now, settings_again(now), same=True)

    def other(self, now: Session, files: Sequence[str]) -> None:
        """Open another scene; of several files one is the scene and the others are its mobiles."""
        scene = next((f for f in files if Path(f).suffix.lower() == ".toml"), files[0])
        self._begin(now, settings_for(now, scene, tuple(f for f in files if f != scene)), same=False)

    def _begin(self, now: Session, settings: Settings, same: bool) -> None:
        self.close()
        self.same, self.problem, self._before = same, "", now.settings
        self.coming = Session(settings, now.log, self._open_with)

    @property
    def progress(self) -> tuple[str, float | None] | None:
        """What is being done, and how much of it is; None while nothing is."""
        if self.coming is None:
            return None
        return ("ready", 1.0) if self.coming.opening is None else self.coming.opening.progress

    def tick(self, now: Session) -> Session | None:
        """Return the session that is to be shown from now on, None while there is none or something is dragged."""
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
        """Have mobiles moved to where they are now; False if they are there, or cannot be."""
        if not self.same or coming.light.move_failed:
            return False
        kept = {name: p for name, p in now.moved.items() if coming.poses.get(name, p) != p}
        if kept:
            coming.move(kept)
        return bool(kept)

    def _take_over(self, now: Session, coming: Session) -> None:
        """Take over what the user has set since it began to open."""
        before, theirs = vars(self._before), () if self.same else OF_A_SCENE
        changed = {name: v for name, v in vars(now.settings).items() if v != before[name] and name not in theirs}
        coming.want(replace(coming.settings, **changed))

    def close(self) -> None:
        """Give up what is being opened."""
        if self.coming is not None:
            self.coming.close(0.0)
            self.coming = None


def settings_again(now: Session) -> Settings:
    """Return settings to load a scene once more: what the user did not set is left open, for it may come out anew."""
    chosen = {name: None for name, value in now.filled.items() if getattr(now.settings, name) == value}
    return replace(now.settings, **chosen, poses=())


def settings_for(now: Session, scene: str, mobiles: tuple[str, ...]) -> Settings:
    """Return settings for another scene: what depends on the one on show is left open."""
    left_open = {name: getattr(Settings, name) for name in OF_A_SCENE}
    return replace(settings_again(now), **left_open, scene=scene, mobiles=mobiles)
