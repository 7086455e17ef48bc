"""The viewer on an X display, for a test of real drops. It prints places of the screen, then each new object.

Run: python -m tests.support.drop_target
"""

from app.session.opening import Opening
from app.settings import Settings
from app.window import window
from app.window.viewer import Viewer
from tests.support import viewer_support as support
from tests.support.viewer_hand import Hand

FLOOR = (0.25, 0.0, 0.75)


def open_edited(settings: Settings, before=None) -> Opening:
    return Opening(settings, load=lambda _: support.room(), before=before)


def main() -> None:
    from imgui_bundle import hello_imgui, immapp

    viewer = Viewer(support.SETTINGS, open_edited)
    named: set[str] = set()

    def say() -> None:
        session, view = viewer.session, viewer.viewport.view
        if not viewer._ready or session.refining or view.size[0] < 10 or viewer.clock.frames < 20:
            return
        if not named:
            x, y = Hand(viewer, None).at(FLOOR)
            print("floor", round(x), round(y), "panel", round(view.origin[0] + view.size[0] + 40), 300, flush=True)
        for name in set(session.poses) - named:
            print("object", name, *session.poses[name].position, flush=True)
        named.update(session.poses)

    viewer.params.callbacks.before_imgui_render = say
    viewer.params.app_window_params.restore_previous_geometry = False
    viewer.params.app_window_params.window_geometry.position = (0, 0)
    viewer.params.app_window_params.window_geometry.position_mode = hello_imgui.WindowPositionMode.from_coords
    viewer.reload.other = lambda now, files: print("opened", *files, flush=True)
    window.prepare()
    immapp.run(viewer.params)


if __name__ == "__main__":
    main()
