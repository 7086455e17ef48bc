"""Delay of the picture behind the cursor as motions begin: `python -m studies.drag_start cornell --photons 1500000`.

A session without a window makes 60 frames per second; a cursor drags the first mobile by 1 % of the scene per frame.
One line per motion and round: milliseconds from the first new pose to the first picture of the motion, the largest
distance of cursor and picture in its first 30 frames, and the job that the motion waited for. Mobile, light and
outline of a picture always have the same pose.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import numpy as np

from app.session.log import Log
from app.session.session import Session
from app.settings import Settings
from gi_core.scene import Pose

FRAME = 1 / 60  # s
DRAWING = 0.005  # s of a frame
FRAMES = 30  # per drag
AT_REST = 60  # frames at rest before a drag, with work at rest under way


class Hand:
    """Drags the first mobile of a session and keeps the delays."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.mobile = session.scene.mobiles[0].name
        self.step = 0.01 * session.chosen.scene_size
        self.found: dict[str, list[tuple[float, float, str]]] = {}
        self._last = time.perf_counter()

    def frame(self) -> None:
        """Run the rest of a frame."""
        time.sleep(max(self._last + FRAME - time.perf_counter(), DRAWING))
        now = time.perf_counter()
        self.session.tick(now - self._last)
        self._last = now

    def until(self, done) -> None:
        while not done():
            self.frame()

    def drag(self, name: str, sign: int) -> None:
        s, light = self.session, self.session.light
        s.begin_drag()
        there, begun, first, far = s.poses[self.mobile], time.perf_counter(), None, 0.0
        job = type(light._job).__name__ + ("" if not getattr(light._job, "settles", False) else " of all photons")
        before = s.light.snapshot.poses[self.mobile]
        for k in range(1, FRAMES + 1):
            x, y, z = there.position
            s.move({self.mobile: Pose((x + sign * k * self.step, y, z), there.quaternion)})
            now = s.light.snapshot.poses[self.mobile]
            if first is None and now != before:
                first = time.perf_counter() - begun
            far = max(far, float(np.linalg.norm(np.subtract(s.poses[self.mobile].position, now.position))))
            self.frame()
        self._note(name, first, far / self.step, job)

    def back(self, name: str, act) -> None:
        """Move all at once, by Esc or undo; a picture of the drag that was under way does not count."""
        s, light = self.session, self.session.light
        begun, job = time.perf_counter(), type(light._job).__name__
        act()
        there = s.poses
        self.until(lambda: s.light.snapshot.poses == there)
        self._note(name, time.perf_counter() - begun, 0.0, job)

    def _note(self, name: str, seconds: float | None, far: float, job: str) -> None:
        self.found.setdefault(name, []).append((1e3 * (seconds or np.inf), far, job))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--photons", type=int, default=1_500_000)
    parser.add_argument("--light", default="photons")
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    session = Session(Settings(scene=asked.scene, photons=asked.photons, light=asked.light), Log())
    while not session.ready:
        time.sleep(0.02)
        session.tick(0.02)
    hand = Hand(session)
    light = session.light
    while light.snapshot.photons < asked.photons / 4:
        hand.frame()
    for k in range(asked.rounds):
        hand.drag("while light refines", (-1) ** k)
        session.end_drag()
        for _ in range(20):
            hand.frame()
    for k in range(asked.rounds):
        hand.until(lambda: not session.refining)
        for _ in range(AT_REST):  # gathering to the end would take minutes
            hand.frame()
        hand.drag("at rest", (-1) ** k)
        session.end_drag()
        hand.until(lambda: not session.refining or (light.is_moving and light._job.settles))  # it may be over soon
        hand.frame()
        hand.drag("0.03 s after a drag", (-1) ** (k + 1))
        hand.back("Esc", lambda: session.end_drag(keep=False))
        hand.until(lambda: not session.refining)
        hand.back("undo", session.undo)
    session.close()
    print("| motion | ms to its first picture, median, longest | largest distance, in frames | jobs waited for |")
    for name, rows in hand.found.items():
        times, far, jobs = zip(*rows, strict=True)
        waits = ", ".join(sorted(set(jobs)))
        print(f"| {name} | {median(times):.0f}, {max(times):.0f} | {median(far):.0f}, {max(far):.0f} | {waits} |")
    for entry in session.log.entries:
        print(entry.level, entry.text)


if __name__ == "__main__":
    main()
