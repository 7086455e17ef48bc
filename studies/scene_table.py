"""A table of scenes opened at default settings: time, memory and pictures of each.

    python -m studies.scene_table DIR cornell room.glb+chair.glb --out FOLDER --write docs/scenes-tried.md

Each scene (a mesh or scene file, a folder of them, a shipped name; `+` adds a mobile) is opened by a separate process
with a time limit. The process takes the steps of the window at rest: a first picture, all photons, gathered light
until it replaces the photons' light. FOLDER keeps its row and two pictures of 1280 x 800: NAME.png of the photons'
light, as `render` draws it, and NAME.gathered.png. A scene that has a row is not opened again. `--write` puts the rows
into a table and keeps the remarks in its last column.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from app import values

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".toml")
LIMIT = 600.0  # s per scene
PATIENCE = 120.0  # CPU seconds that are spent on gathering, where it does not take over before
BEGIN, END = "<!-- table -->", "<!-- end of table -->"
HEAD = (
    "scene", "triangles in the file", "as drawn", "receivers", "photons", "first picture (CPU)", "ready (CPU)",
    "gathered light (CPU)", "load", "the picture",
)  # fmt: skip


def cases(wanted: list[str]) -> list[tuple[str, str]]:
    """Return (name in the table, scene to open) per scene; names have the last folder of the path alone."""
    found = []
    for what in wanted:
        folder = Path(what)
        if not folder.is_dir():
            found.append(("+".join(_name(part) for part in what.split("+")), what))
            continue
        files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)
        found += [(str(p.relative_to(folder)), str(p)) for p in files]
    return found


def measure(what: str, picture: Path, launched: float, photons: int | None, size: tuple[int, int]) -> dict:
    """Open a scene like the window does, up to its first picture, then trace the rest; gather; write the pictures.

    launched: `time.time()` of the moment before this process began; photons: fewer than would be chosen.
    """
    import numpy as np

    from app.cli.progress import Bar, compile_kernels
    from app.draw.picture_files import write_png
    from app.draw.shot import Shot
    from app.session.picture import metadata_of
    from app.settings import Settings, make_solver, open_scene
    from gi_core.files.formats.mesh_file import read_mesh_file
    from gi_core.scene import SceneError

    static, *mobiles = what.split("+")
    settings = Settings(scene=static, mobiles=tuple(mobiles), size=size, light="best")
    stages, cpu, row = {}, {}, {}

    def passed(stage: str) -> None:
        stages[stage], cpu[stage] = round(time.time() - launched, 2), round(time.process_time(), 2)

    compile_kernels(Bar())
    passed("imported")
    try:
        scene = open_scene(settings)
    except SceneError as error:
        return {"refused": str(error)}
    passed("loaded")
    solver = make_solver(scene, settings)
    passed("prepared")
    row["photons"] = solver.photons
    if photons is not None:
        solver.configure(photons=min(photons, solver.photons))
    shown = False
    for progress in solver.solve_steps():
        if progress.picture and not shown:
            passed("first")
            shown = True
    passed("ready")
    shot = Shot(solver, settings)
    write_png(picture, shot.take(), metadata_of(shot))
    passed("drawn")
    began = time.process_time()
    for progress in solver.gather_steps():
        if (progress.picture and solver.frame_light.is_gathered) or time.process_time() - began > PATIENCE:
            break
    if solver.frame_light.is_gathered and progress.picture:
        passed("gathered")
        write_png(picture.with_suffix(".gathered.png"), shot.take(), metadata_of(shot))
    s = solver.surfaces
    if not static.endswith(".toml") and os.path.isfile(static):
        row["file"] = len(read_mesh_file(Path(static)).mesh.faces)
    row |= {
        "drawn": int(s.first_face[-1]),
        "receivers": len(solver.irradiance),
        "radius": solver.setting.radius,
        "scene_size": solver.scene_size,
        "black": round(float((solver.irradiance.max(axis=1) <= 0).mean()), 4),
        "nan": bool(np.isnan(solver.irradiance).any()),
        "exposure": round(float(shot.exposure), 2),
        "camera": [list(map(float, v)) for v in (scene.camera.position, scene.camera.target)],
        "notes": list(scene.notes),
    }
    return row | {"stages": stages, "cpu": cpu}


def table(rows: list[dict], looked: dict[str, str]) -> str:
    """Return the rows as Markdown; `looked` has the last column by name."""
    lines = [f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}"]
    for row in rows:
        cells = [row["name"], *_facts(row), looked.get(row["name"], "not looked at yet")]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def looked_at(text: str) -> dict[str, str]:
    """Return the last column of a document's table by the first one."""
    inside = text.partition(BEGIN)[2].partition(END)[0]
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in inside.splitlines() if line.startswith("| ")]
    return {c[0]: c[-1] for c in cells if len(c) == len(HEAD) and c[0] != HEAD[0]}


def write_table(document: Path, rows: list[dict]) -> None:
    """Replace the table of a document, between its two marks."""
    text = document.read_text(encoding="utf-8")
    before, found, rest = text.partition(BEGIN)
    after = rest.partition(END)[2]
    if not found:
        raise SystemExit(f"{document} needs the lines {BEGIN} and {END} where the table shall stand")
    document.write_text(f"{before}{BEGIN}\n{table(rows, looked_at(text))}{END}{after}", encoding="utf-8")


def _facts(row: dict) -> list[str]:
    if "refused" in row or "failed" in row:
        return [*[""] * 7, "refused" if "refused" in row else "failed"]
    count = [f"{row[k]:,}" if k in row else "" for k in ("file", "drawn", "receivers", "photons")]
    times = [_time(row, k) for k in ("first", "ready", "gathered")]
    return [*count, *times, f"{row['load']:.0f}"]


def _time(row: dict, stage: str) -> str:
    """Return when a stage was passed, seconds by the clock and CPU seconds."""
    return f"{row['stages'][stage]:.1f} s ({row['cpu'][stage]:.1f})" if stage in row["stages"] else "not yet"


def _name(part: str) -> str:
    path = Path(part)
    return f"{path.parent.name}/{path.name}" if path.suffix and path.parent.name else part


def _child(what: str, name: str, out: Path, limit: float, options: list[str]) -> dict:
    """Open one scene in a separate process; return its row, or the reason for its absence."""
    stem = name.replace("/", "-").replace("+", "_with_")
    row_file, picture = out / f"{stem}.json", out / f"{stem}.png"
    if row_file.is_file():
        return json.loads(row_file.read_text())
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    command = [sys.executable, "-m", "studies.scene_table", "--one", what, "--picture", str(picture)]
    command += options
    try:
        done = subprocess.run(
            [*command, "--launched", repr(time.time())], capture_output=True, text=True, timeout=limit, check=False
        )
        row = json.loads(done.stdout) if done.returncode == 0 else {"failed": done.stderr.strip().splitlines()[-1:]}
    except subprocess.TimeoutExpired:
        row = {"failed": [f"not done after {limit:g} s"]}
    row = {"name": name, "load": round(load, 1), **row}
    row_file.write_text(json.dumps(row, indent=1))
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="files, folders of files, shipped names; FILE+MOBILE")
    parser.add_argument("--out", type=Path, help="folder for rows and pictures")
    parser.add_argument("--write", type=Path, help="a document whose table is brought up to date")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds a scene may take")
    parser.add_argument("--size", type=values.size, default=(1280, 800), help="of the pictures")
    parser.add_argument("--photons", type=int, help="trace no more than that, where the machine is busy")
    for hidden in ("--one", "--picture", "--launched"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(measure(asked.one, Path(asked.picture), float(asked.launched), asked.photons, asked.size)))
        return
    if not asked.out:
        parser.error("--out names the folder for rows and pictures")
    asked.out.mkdir(parents=True, exist_ok=True)
    subprocess.run([sys.executable, "-m", "gi_core.instruments.compile_ahead"], stdout=subprocess.DEVNULL, check=True)
    rows = []
    for name, what in cases(asked.scenes):
        options = [f"--size={asked.size[0]}x{asked.size[1]}"]
        options += [] if asked.photons is None else [f"--photons={asked.photons}"]
        row = _child(what, name, asked.out, asked.limit, options)
        rows.append(row)
        print(name, *_facts(row), row.get("refused", row.get("failed", "")), flush=True)
    if asked.write:
        write_table(asked.write, rows)


if __name__ == "__main__":
    main()
