"""A baked file drawn by three.js in headless Chromium, compared with `render`.

    python -m studies.baked_in_browser SCENE --three FOLDER [--photons N] [--seconds S]

FOLDER is the npm package `three`, unpacked. Chromium draws by software GL. Both pictures have the tone map "clip".
Prints the mean difference of display values, relative to their mean, of all pixels and of those without edges.
"""

from __future__ import annotations

import argparse
import base64
import functools
import http.server
import io
import re
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

import numpy as np
from PIL import Image

from app.cli.progress import Bar, compile_kernels, solve
from app.draw.baking import baked
from app.draw.shot import Shot
from app.rest.timed_gathering import gather
from app.settings import Settings, make_solver, open_scene

PAGE = """<!DOCTYPE html><html><body><pre id="out"></pre>
<script type="importmap">{"imports": {"three": "./three/build/three.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "./three/examples/jsm/loaders/GLTFLoader.js";
const say = text => { document.getElementById("out").textContent = text; };
new GLTFLoader().load("scene.glb", gltf => {
  const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.setSize(WIDTH, HEIGHT);
  const notes = gltf.parser.json.scenes[0].extras;
  renderer.toneMapping = THREE.LinearToneMapping;
  renderer.toneMappingExposure = 2 ** (notes.picture_exposure - notes.exposure);
  const scene = new THREE.Scene(), camera = gltf.cameras[0];
  scene.background = new THREE.Color("BACKGROUND");
  scene.add(gltf.scene);
  camera.aspect = WIDTH / HEIGHT;
  camera.updateProjectionMatrix();
  renderer.render(scene, camera);
  say(renderer.domElement.toDataURL("image/png"));
}, undefined, error => say("error " + error));
</script></body></html>"""
BROWSER = (
    "--headless=new --no-sandbox --disable-gpu-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --dump-dom"
    " --virtual-time-budget=60000 --hide-scrollbars"
).split()


def drawn_by_three(glb: bytes, three: Path, size: tuple[int, int], background: str) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 of a GLB file by three.js."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.glb").write_bytes(glb)
        (folder / "three").symlink_to(three.resolve())
        page = PAGE.replace("WIDTH", str(size[0])).replace("HEIGHT", str(size[1])).replace("BACKGROUND", background)
        (folder / "index.html").write_text(page)
        handler = functools.partial(_Quiet, directory=name)
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            chromium = shutil.which("chromium") or shutil.which("google-chrome")
            command = [chromium, *BROWSER, f"--user-data-dir={folder / 'profile'}"]
            url = f"http://127.0.0.1:{server.server_address[1]}/index.html"
            dom = subprocess.run([*command, url], capture_output=True, text=True, timeout=180).stdout
            server.shutdown()
    found = re.search(r"data:image/png;base64,([^<]+)", dom)
    if not found:
        raise RuntimeError(f"three.js drew nothing: {dom[-500:]}")
    return np.array(Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("RGB"))


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_) -> None:
        pass


def difference(ours: np.ndarray, theirs: np.ndarray) -> tuple[float, float]:
    """Return the mean absolute difference over the mean value: of all pixels, and of pixels without edges."""
    a, b = ours.astype(float), theirs.astype(float)
    steps = [np.abs(np.diff(a, axis=k, append=a.take([-1], k))).max(axis=2) for k in (0, 1)]
    flat = np.maximum(*steps) < 8
    return tuple(float(np.abs(a - b)[rows].mean() / a[rows].mean()) for rows in (np.ones_like(flat), flat))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("--three", type=Path, required=True)
    parser.add_argument("--photons", type=int)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--out", type=Path, default=Path("."))
    a = parser.parse_args()
    settings = Settings(a.scene, photons=a.photons, size=(640, 480), tone_map="clip")
    with Bar() as bar:
        compile_kernels(bar)
        solver = make_solver(open_scene(settings), settings)
        solve(solver, bar)
        gather(solver, a.seconds, bar)
    shot = Shot(solver, settings)
    ours = shot.take()
    glb = baked(solver, shot.meshes, solver.irradiance, shot.camera, None, shot.gains, shot.exposure).glb
    background = "#" + "".join(f"{v:02x}" for v in ours[0, 0])
    theirs = drawn_by_three(glb, a.three, settings.size, background)
    every, flat = difference(ours, theirs)
    for name, picture in (("ours", ours), ("three", theirs)):
        Image.fromarray(picture).save(a.out / f"{Path(a.scene).stem}-{name}.png")
    print(f"{a.scene}: {len(glb):,} bytes, difference {100 * every:.2f} %, without edges {100 * flat:.2f} %")


if __name__ == "__main__":
    main()
