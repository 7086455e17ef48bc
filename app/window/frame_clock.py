"""Times of frames: how long light may take in each, and until when a picture or the window waits."""

from __future__ import annotations

import time

from app.session.session import LIGHT_TIME

LONGEST_WAIT = 0.02  # s per frame for refinement if drawing is slow
LINGER = 1.0  # s of frames after the last input: tooltips come and fade
LONGEST_REST = 4.0  # s without a new picture at rest: light gets as much time as slow drawing takes
LONGEST_STEP = 0.1  # s per frame of an animation: it does not jump after a pause of the program


class FrameClock:
    """`begin` and `end` with each frame."""

    def __init__(self) -> None:
        self.frames = 0
        self.slept = False  # between the last frame and this one
        self.seconds = 0.0  # since the frame before, at most LONGEST_STEP
        self.light_seconds = 0.0  # of the last frame: refinement or a move
        self.light_until = 0.0  # without input, light has its time until then
        self.awake_until = 0.0  # after input
        self._before = time.perf_counter()

    def begin(self, has_input: bool) -> float:
        """Begin a frame; return the time [s] since the last one began."""
        now = time.perf_counter()
        seconds, self._before = now - self._before, now
        self.seconds = min(seconds, LONGEST_STEP)
        self.frames += 1
        if has_input:
            self.awake_until = now + LINGER
        return seconds

    def drew(self) -> None:
        """Give light as much time as this frame's picture took."""
        now = time.perf_counter()
        self.light_until = now + min(now - self._before - self.light_seconds, LONGEST_REST)

    def wake(self) -> None:
        """End a sleep: it does not count as time of a frame."""
        self._before = max(self._before, time.perf_counter() - LONGEST_WAIT)

    @property
    def is_awake(self) -> bool:
        """Whether input was a moment ago."""
        return time.perf_counter() < self.awake_until

    @property
    def is_lights_turn(self) -> bool:
        """Whether light has its time, before the next picture."""
        return time.perf_counter() < self.light_until

    def budget(self, moving: bool) -> float:
        """Return the time to wait for refinement [s]: as long as the rest of a frame takes, within bounds.

        moving: the camera is. Slow drawing runs on the same cores: half of the time is for light while nothing moves.
        """
        return LIGHT_TIME if moving else min(max(self.seconds - self.light_seconds, LIGHT_TIME), LONGEST_WAIT)
