"""The window: availability, size, OpenGL version, docking, ini file.

This module imports no GUI at the top, so that `why_no_window` can answer without the GUI's shared libraries.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from app.settings import Settings
from app.window import theme
from gi_core.scene.errors import utf8

TITLE = "gi-viewer"
GL_VERSION = (3, 3)  # macOS has at most 4.1
DRIVERS = "install an OpenGL driver (Debian, Ubuntu: `apt install libgl1 libegl1 libgl1-mesa-dri`)"
RENDER_HINT = "`gi-viewer render SCENE --out a.png` needs no window"


def why_no_window() -> str | None:
    """Return None if a window with OpenGL 3.3 opens, else one sentence with cause and remedy.

    The test opens an invisible window, because variables like DISPLAY prove nothing.
    """
    try:
        # imgui_bundle before glfw: then both use the same libglfw.
        import_module("imgui_bundle")
        import glfw
    except (ImportError, OSError) as problem:
        return _sentence(*_missing_library(str(problem)))
    messages: list[str] = []
    glfw.set_error_callback(lambda code, text: messages.append(f"{text.decode(errors='replace')} ({code})"))
    window = None
    try:
        if not glfw.init():
            return _sentence("no display can be opened" + _quoted(messages), "start it in a desktop session")
        glfw.default_window_hints()
        hint_opengl()
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        window = glfw.create_window(64, 64, TITLE, None, None)
        if not window:
            return _sentence(f"OpenGL {GL_VERSION[0]}.{GL_VERSION[1]} is not available{_quoted(messages)}", DRIVERS)
        glfw.make_context_current(window)
        try:
            current_context()
        except Exception as problem:  # moderngl raises plain Exception for anything GL
            return _sentence(f"OpenGL {GL_VERSION[0]}.{GL_VERSION[1]} does not start ({problem})", DRIVERS)
        return None
    except Exception as problem:  # glfw's wrapper may raise its errors
        return _sentence(f"no window opens ({problem})", DRIVERS)
    finally:
        if window:
            glfw.make_context_current(None)
            glfw.destroy_window(window)
        glfw.terminate()
        glfw.set_error_callback(None)


def prepare() -> None:
    """Initialise glfw with the OpenGL hints before HelloImGui makes its window."""
    import_module("imgui_bundle")
    import glfw

    if glfw.init():
        glfw.default_window_hints()
        hint_opengl()


def hint_opengl() -> None:
    """Request GL_VERSION for the next window; glfw must be initialised."""
    import glfw

    glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, GL_VERSION[0])
    glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, GL_VERSION[1])
    glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
    glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, glfw.TRUE)
    if hasattr(glfw, "get_platform") and glfw.get_platform() == getattr(glfw, "PLATFORM_NULL", None):
        # glfw's null platform defaults to OSMesa; EGL is installed more often.
        glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)


def wait_for_input(seconds: float) -> bool:
    """Wait for at most `seconds`; return whether input, or another event of the window, came in that time."""
    import glfw
    from imgui_bundle import imgui

    end = time.monotonic() + seconds
    glfw.wait_events_timeout(seconds)
    return len(imgui.get_current_context().input_events_queue) > 0 or time.monotonic() < end


def current_context():
    """Return a moderngl context on glfw's current GL context, of any platform (GLX, EGL, WGL)."""
    import glfw
    import moderngl

    class Loader:
        def load_opengl_function(self, name: str) -> int:
            address = glfw.get_proc_address(name)
            return ctypes.cast(address, ctypes.c_void_p).value or 0 if address else 0

        def __enter__(self):
            return self

        def __exit__(self, *_) -> None:
            pass

        def release(self) -> None:
            pass

    return moderngl.create_context(require=100 * GL_VERSION[0] + 10 * GL_VERSION[1], context=Loader())  # type: ignore[arg-type]


def runner_params(
    settings: Settings,
    viewport: Callable[[], None],
    panel: Callable[[], None],
    status: Callable[[], None],
    menus: Callable[[], None],
):
    """Return HelloImGui's parameters: menu bar, viewport, panel at its right, status line."""
    from imgui_bundle import hello_imgui, imgui

    params = hello_imgui.RunnerParams()
    window = params.app_window_params
    window.window_title = title_of(settings.document or settings.scene)
    window.window_geometry.size = settings.size
    window.restore_previous_geometry = settings.size == Settings().size

    gl = hello_imgui.OpenGlOptions()
    gl.major_version, gl.minor_version = GL_VERSION
    gl.glsl_version, gl.use_core_profile, gl.use_forward_compat = "330", True, True
    gl.anti_aliasing_samples = 0  # the renderer multisamples the scene itself
    params.renderer_backend_options.open_gl_options = gl

    params.ini_folder_type = hello_imgui.IniFolderType.absolute_path
    folder = config_folder()
    ini = (folder or Path()) / ini_name(screen_scale())
    params.ini_disable = folder is None or ini.is_dir()  # HelloImGui would end the program
    params.ini_filename = str(ini)
    params.fps_idling.enable_idling = False  # the viewer itself sleeps between frames
    params.fps_idling.remember_enable_idling = False
    params.callbacks.load_additional_fonts = theme.load_fonts
    params.callbacks.setup_imgui_style = theme.set_style
    params.callbacks.setup_imgui_config = theme.set_config
    params.callbacks.show_status = status

    gui = params.imgui_window_params
    gui.default_imgui_window_type = hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
    gui.show_menu_bar, gui.show_status_bar, gui.show_status_fps = True, True, False
    gui.show_menu_app = gui.show_menu_view = False
    params.callbacks.show_menus = menus
    gui.remember_status_bar_settings = gui.remember_theme = False
    gui.config_windows_move_from_title_bar_only = True  # else a drag in the viewport drags the window
    gui.background_color = (*theme.WINDOW, 1.0)

    split = hello_imgui.DockingSplit()
    split.initial_dock, split.new_dock = "MainDockSpace", "Side"
    split.direction = imgui.Dir.right
    split.ratio = min(22 * theme.FONT_PIXELS / settings.size[0], 0.55)  # until Steady of the panel sets it
    params.docking_params.docking_splits = [split]
    no_tabs = int(imgui.internal.DockNodeFlagsPrivate_.no_tab_bar)
    split.node_flags = params.docking_params.main_dock_space_node_flags = no_tabs

    shown = hello_imgui.DockableWindow("Viewport", "MainDockSpace", viewport, can_be_closed_=False)
    shown.call_begin_end = False  # its zero padding must be set before `begin`
    beside = hello_imgui.DockableWindow("Panel", "Side", panel, can_be_closed_=False)
    beside.remember_is_visible = False
    # a window narrower than 45 em starts without the panel
    beside.is_visible = settings.size[0] >= 45 * theme.FONT_PIXELS
    params.docking_params.dockable_windows = [shown, beside]
    return params


def title_of(scene: str) -> str:
    return f"{utf8(Path(scene).stem)} - {TITLE}"


def on_drop(take: Callable[[list[str]], None]) -> None:
    """Call `take` with the names of files dropped on the current window.

    glfw's Python wrapper reads names as UTF-8; others would end the program.
    """
    import glfw

    if window := glfw.get_current_context():
        _dropped[:] = [glfw._GLFWdropfun(lambda _, n, names: take([os.fsdecode(names[k]) for k in range(n)]))]
        glfw._glfw.glfwSetDropCallback(window, _dropped[0])


_dropped: list = []  # the function that GLFW calls


def refuse_to_close() -> None:
    """Take back the user's wish to close the current window."""
    import glfw

    if window := glfw.get_current_context():
        glfw.set_window_should_close(window, False)


def toggle_full_screen() -> None:
    """Let the current window fill its screen, or give it its place back."""
    import glfw

    window, monitor = glfw.get_current_context(), glfw.get_primary_monitor()
    if not window or not monitor:
        return
    if glfw.get_window_monitor(window):
        glfw.set_window_monitor(window, None, *_place_before, 0)
        return
    _place_before[:] = [*glfw.get_window_pos(window), *glfw.get_window_size(window)]
    mode = glfw.get_video_mode(monitor)
    glfw.set_window_monitor(window, monitor, 0, 0, mode.size.width, mode.size.height, mode.refresh_rate)


_place_before = [0, 0, 1280, 800]  # of a full-screen window: x, y, width, height


def rename(scene: str) -> None:
    """Set the current window's title for a scene."""
    import glfw

    if window := glfw.get_current_context():
        glfw.set_window_title(window, title_of(scene))


def screen_scale() -> float:
    """Return the desktop's scale relative to 96 dots per inch; 1 without a screen."""
    import glfw

    monitor = glfw.get_primary_monitor() if glfw.init() else None
    return glfw.get_monitor_content_scale(monitor)[0] if monitor else 1.0


def ini_name(scale: float) -> str:
    """Return the ini file's name, one per scale, because the file holds the panel's width in pixels."""
    return "window.ini" if scale == 1 else f"window-{scale:g}x.ini"


def config_folder() -> Path | None:
    """Return the folder of the window's ini file, creating it; None if that fails: nothing is stored."""
    import platformdirs

    try:
        return Path(platformdirs.user_config_dir(TITLE, appauthor=False, ensure_exists=True))
    except OSError:
        return None


def _sentence(cause: str, remedy: str) -> str:
    return f"{cause}; {remedy}; {RENDER_HINT}"


def _quoted(messages: list[str]) -> str:
    return f" ({messages[-1]})" if messages else ""


def _missing_library(problem: str) -> tuple[str, str]:
    packages = {"libX11": "libx11-6", "libGL.": "libgl1", "libEGL": "libegl1", "libGLX": "libglx0"}
    for library, package in packages.items():
        if library in problem:
            name = library.rstrip(".")
            return f"the library {name} is missing", f"install it (Debian, Ubuntu: `apt install {package}`)"
    return f"the GUI does not load ({problem})", "reinstall gi-viewer (`pip install --force-reinstall gi-viewer`)"
