"""Damaged files for the loaders: `python -m studies.fuzz --cases 20000 --out DIR [--kinds obj,glb] [--seed 0]`.

Guided by coverage: an input that reaches a new pair of lines of the loaders is kept and damaged further. Each case
must end in a scene or in one sentence (SceneError), within 20 s of computing and a gigabyte, without a warning.
Other cases go to DIR/found with their traceback, and the exit code is 1. A separate process runs the cases and is
started again when it dies; DIR/corpus keeps the inputs. Linux alone (memory limit, alarm).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

from tests.support.fuzz_mutations import mutate, seeds, surroundings
from tests.support.mesh_writers import ROOM

MEMORY = 1 << 30  # bytes that a case may allocate
SECONDS = 20  # of computing, for a case
PATIENCE, FIRST = 180, 900  # s that the supervisor waits for an answer; for the first, compiling included
LONGEST = 700  # characters of a sentence
WHOLE, LIT = 20, 100  # every WHOLE-th case, and each with new lines, is completed; every LIT-th is lit by 200 photons
ROOT = Path(__file__).resolve().parent.parent


class Hang(BaseException):
    """A case took too long."""


class Coverage:
    """Pairs of consecutive lines run in the loaders."""

    def __init__(self) -> None:
        import trimesh.exchange.ply
        import trimesh.exchange.stl

        self.files = {str(p) for p in (ROOT / "gi_core" / "files").rglob("*.py")}
        self.files |= {trimesh.exchange.ply.__file__, trimesh.exchange.stl.__file__}
        self.seen: set[tuple] = set()
        self.new = False

    def __call__(self, frame, event, argument):
        code = frame.f_code
        if code.co_filename not in self.files:
            return None
        before = 0

        def local(frame, event, argument):
            nonlocal before
            if event == "line":
                pair = code, before, frame.f_lineno
                before = frame.f_lineno
                if pair not in self.seen:
                    self.seen.add(pair)
                    self.new = True
            return local

        return local


def check(path: Path, whole: bool, light: bool) -> str:
    """Read a file and return the outcome; raises exceptions that a user must never see.

    whole: complete it to a scene as well (placing, camera, pilot trace: a second); light: and light that.
    """
    from gi_core.files.formats.boundary import Boundary
    from gi_core.files.formats.mesh_file import read_mesh_file
    from gi_core.files.formats.photometry_file import SUFFIXES, read_photometry
    from gi_core.files.formats.toml_file import read_scene_file
    from gi_core.files.load import load_scene
    from gi_core.scene import SceneError
    from gi_core.solver import Solver

    try:
        if path.suffix in SUFFIXES:
            read_photometry(path, str(path), Boundary(path.parent))
            return "read"
        if not (whole or light):
            read_scene_file(path, str(path)) if path.suffix == ".toml" else read_mesh_file(path)
            return "read"
        scene = load_scene(path, max_edge=float("inf"))
        if light:
            solver = Solver(scene, photons=200, threads=1)
            solver.solve()
            assert (solver.irradiance >= 0).all(), "irradiance is negative or NaN"
            return "lit"
        return "loaded"
    except SceneError as error:
        text = str(error)
        assert "fit into memory" not in text, text
        assert path.name in text and text.isprintable() and len(text) < LONGEST, f"not a sentence: {text[:2000]!r}"
        return "refused"


def work(options) -> int:
    """Run cases until they are done; one line of JSON each on stdout."""
    out = Path(options.out)
    corpus: dict[str, list[bytes]] = {k: v for k, v in seeds().items() if k in options.kinds}
    for file in sorted((out / "corpus").iterdir()):
        if file.suffix[1:] in corpus:
            corpus[file.suffix[1:]].append(file.read_bytes())
    folder = Path(tempfile.mkdtemp(dir=out))
    surroundings(folder)
    warnings.simplefilter("error", RuntimeWarning)
    cover, kept = Coverage(), {k: len(v) for k, v in corpus.items()}

    def hang(*_):
        raise Hang(f"took more than {SECONDS} s")

    signal.signal(signal.SIGPROF, hang)
    check(_placed(folder, "obj", corpus.get("obj", seeds()["obj"])[0]), True, True)  # imports, kernels
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    queue = [(k, d) for k, v in corpus.items() for d in v]  # first as they are, for their coverage
    for case in range(options.first, options.first + options.cases + len(queue)):
        rng = random.Random(f"{options.seed} {case}")
        if queue:
            kind, data = queue.pop()
        else:
            kind = rng.choice(list(corpus))
            data = mutate(rng, kind, rng.choice(corpus[kind]), rng.choice(corpus[kind]))
        (out / "current").write_bytes(data)
        path = _placed(folder, kind, data)
        cover.new = False
        begun, trouble, result = time.monotonic(), None, "found"
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        sys.settrace(cover)
        try:
            result = check(path, case % WHOLE == 0, case % LIT == 0)
            if cover.new and result != "lit":
                result = check(path, True, False)
                sys.settrace(None)
                result = check(path, True, True)
        except (Exception, Hang) as problem:
            sys.settrace(None)
            trouble = f"{type(problem).__name__}: {problem}"
            place = [f for f in traceback.extract_tb(problem.__traceback__)][-1]
            _keep(out, kind, data, f"{type(problem).__name__} {place.filename}:{place.lineno}", traceback.format_exc())
        finally:
            sys.settrace(None)
            signal.setitimer(signal.ITIMER_PROF, 0)
        if cover.new and trouble is None and data not in corpus[kind]:
            corpus[kind].append(data)
            (out / "corpus" / f"{_name(data)}.{kind}").write_bytes(data)
        seconds = time.monotonic() - begun
        print(json.dumps([case, kind, result, trouble, len(cover.seen), round(seconds, 2)]), flush=True)
    print(json.dumps({k: len(v) - kept[k] for k, v in corpus.items()}), file=sys.stderr)
    return 0


def _placed(folder: Path, kind: str, data: bytes) -> Path:
    """Write a case where it is read from; an MTL is read through an OBJ that names it."""
    path = folder / f"case.{kind}"
    path.write_bytes(data)
    if kind == "mtl":
        path = folder / "case.obj"
        path.write_text(ROOM.replace("room.mtl", "case.mtl"))
    return path


def _name(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]


def _keep(out: Path, kind: str, data: bytes, where: str, text: str) -> None:
    """Write a finding down, once a place in the code."""
    name = hashlib.sha256(where.encode()).hexdigest()[:8]
    if not (out / "found" / f"{name}.txt").exists():
        (out / "found" / f"{name}.{kind}").write_bytes(data)
        (out / "found" / f"{name}.txt").write_text(f"{where}\n{text}")


def supervise(options) -> int:
    """Run the worker until all cases are done, start it again where it died; print counts, return the exit code."""
    out = Path(options.out)
    for name in ("corpus", "found"):
        (out / name).mkdir(parents=True, exist_ok=True)
    counts, kinds, done, deaths, lines, slowest = Counter(), Counter(), 0, 0, 0, 0.0
    begun = time.monotonic()
    while done < options.cases:
        command = [sys.executable, "-m", "studies.fuzz", "--worker", "--first", str(options.first + done)]
        command += ["--cases", str(options.cases - done), "--seed", options.seed, "--out", str(out)]
        command += ["--kinds", ",".join(options.kinds)]
        worker = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
        last = None
        while True:
            ready, _, _ = select.select([worker.stdout], [], [], FIRST if last is None else PATIENCE)
            line = worker.stdout.readline() if ready else b""
            if not line:
                worker.kill()
                code = worker.wait()
                break
            last = json.loads(line)
            counts[last[2]] += 1
            kinds[last[1]] += 1
            lines, slowest, done = last[4], max(slowest, last[5]), done + 1
            if last[3] is not None:
                print(f"case {last[0]} ({last[1]}): {last[3][:300]}", flush=True)
            if done % 1000 == 0:
                seconds = time.monotonic() - begun
                print(f"{done} cases, {seconds:.0f} s, {lines} pairs of lines, {dict(counts)}", flush=True)
        if done < options.cases and code:
            deaths += 1
            kind = options.kinds[0] if last is None else last[1]
            where = f"the process died or hung, exit code {code}, after case {last and last[0]}"
            print(where, flush=True)
            if (out / "current").exists():
                _keep(out, "bin", (out / "current").read_bytes(), f"{where} {deaths}", kind)
            done += 1
            if deaths > 50 or last is None:
                break
    print(f"{done} cases {dict(kinds)}: {dict(counts)}, {deaths} deaths, {lines} pairs of lines, slowest {slowest} s")
    found = sorted((out / "found").glob("*.txt"))
    for file in found:
        print(file, file.read_text().splitlines()[0])
    return 1 if found else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", default="0")
    parser.add_argument(
        "--kinds", type=lambda s: s.split(","), default=list("toml obj mtl glb gltf ply stl ies ldt".split())
    )
    parser.add_argument("--out", required=True)
    parser.add_argument("--worker", action="store_true")
    options = parser.parse_args()
    return work(options) if options.worker else supervise(options)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
