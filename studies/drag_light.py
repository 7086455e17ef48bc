"""Time from a moved light to its picture, while a lamp is dragged, without a window.

    python -m studies.drag_light office "desk lamp middle" --seconds 20

The light goes round a circle, one step per frame of 16 ms, as by the hand. Each step is an edit of the scene; steps
that come while one is being opened are dropped, except the newest. Pictures are not drawn, so all of both cores is free
for the light. The scene rests for a while before, so its light is gathered.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time

import numpy as np

from app.session.log import Log
from app.session.opening import Opening
from app.session.reload import Reload
from app.session.session import Session
from app.settings import Settings
from gi_core.files.edits import Light

FRAME = 0.016  # s
ROUND = 4.0  # s per circle


def ready(settings: Settings) -> Session:
    session = Session(settings, Log())
    while not session.ready:
        session.tick(FRAME)
        if session.problem is not None:
            raise session.problem
        time.sleep(FRAME)
    return session


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("light")
    parser.add_argument("--seconds", type=float, default=15.0, help="of dragging")
    parser.add_argument("--rest", type=float, default=10.0, help="seconds before")
    parser.add_argument("--radius", type=float, default=0.2, help="of the circle [m]")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder  # nothing is known from before
        session, reload = ready(Settings(scene=asked.scene, light="best")), Reload(Opening)
        begun = time.perf_counter()
        while time.perf_counter() - begun < asked.rest:
            session.tick(FRAME)
        centre = next(light for light in session.scene.lights if light.name == asked.light).position
        begun, first, took = time.perf_counter(), True, []
        given: dict[tuple, float] = {}  # time of each place
        while (now := time.perf_counter()) - begun < asked.seconds:
            angle = 2 * math.pi * (now - begun) / ROUND
            way = np.array([math.cos(angle), 0.0, math.sin(angle)])
            place = tuple((np.array(centre) + asked.radius * way).tolist())
            given[place] = now
            session.change_scene(Light(asked.light, (("position", place),)), first=first)
            first = False
            session.tick(FRAME, still=not reload.is_editing)
            if (new := reload.tick(session)) is not None:
                session.close(0.0)
                session = new
                shown = next(light for light in session.scene.lights if light.name == asked.light).position
                took.append(time.perf_counter() - given[shown])
            time.sleep(max(FRAME - (time.perf_counter() - now), 0.0))
        session.close()
        print(f"{asked.scene}, {asked.light}: {len(took) / asked.seconds:.1f} pictures per second")
        shares = ", ".join(f"{q} % {1e3 * np.percentile(took, q):.0f} ms" for q in (50, 95))
        print(f"from a step to its picture: {shares}")


if __name__ == "__main__":
    main()
