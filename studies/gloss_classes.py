"""Classes of gloss per mesh file: deviation of triangles from their class, and the cost of sharp lobes.

    python -m studies.gloss_classes FILE.glb ...

Deviations are means over the area: of roughness, metallic, and F0 of metal. `reflectors` is the CPU time that pictures
need for taps and albedos of sharp lobes, once per scene.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gi_core.files import gloss_classes
from gi_core.files.formats import classes as few_classes
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import flatten
from gi_core.gloss import sharp

COUNTS = 1, 8, 16, 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE")
    classes, found = gloss_classes.classes, []

    def watched(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        found.append((values, weights, classes(values, weights)))
        return found[-1][2]

    gloss_classes.classes = watched
    for file in parser.parse_args().files:
        for count in COUNTS:
            few_classes.MOST = count
            found.clear()
            scene = load_scene(file)
            surfaces, _ = flatten(scene)
            sharp._sharp_lobe.cache_clear()
            start = time.process_time()
            parts = len(sharp.sharp_faces(surfaces)[0])
            seconds = time.process_time() - start
            total, area, kinds = np.zeros(5), 0.0, 0
            for values, weights, of in found:
                for c in range(of.max() + 1):
                    v, w = values[of == c], weights[of == c]
                    total += w @ np.abs(v - w @ v / w.sum())
                area, kinds = area + weights.sum(), kinds + of.max() + 1
            roughness, metallic, *metal = total / area
            print(f"{file} at most {count}: {kinds} classes, roughness {roughness:.4f}, metallic {metallic:.4f}, F0 "
                  f"{np.mean(metal):.4f}; {parts} reflectors, {seconds:.2f} s", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
