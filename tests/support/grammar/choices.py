"""Random choices that all productions share, and the odd values among them."""

import math
import random

Files = dict[str, bytes]  # by name

NUMBERS = [0, -1, 1, 2, -0.0, 0.5, 1e-45, 1e-300, 1e-12, 1e7, 1e15, 1e30, 1e300, 1.7e308, math.inf, -math.inf, math.nan]
WHOLES = [0, -1, 1, 2, 3, 7, 255, 256, 65535, 65536, 10**6, 2**31 - 1, 2**31, 2**32, 2**63 - 1, 2**63, 10**30, -(2**63)]
TEXTS = [
    "", " ", ".", "..", "/", "~", "a/b", "../room.obj", "/dev/zero", "/etc/passwd", "C:\\a", "a\x00b", "\x1b[31m",
    "é\u202e\U0001f600",
]  # fmt: skip
TEXTS += [
    "x" * 300, "x" * 70000, "pipe", "folder", "loop", "%2e%2e/x", "http://localhost:9/a", "file:///etc/passwd",
    "data:,", "None", "-0",
]  # fmt: skip


class Grammar:
    """A source of random choices that all productions share."""

    def __init__(self, seed: int, oddity: float) -> None:
        self.rng = random.Random(seed)
        self.oddity = oddity
        self.dark = False  # materials must not emit: they are those of a mobile

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def pick(self, *options):
        return self.rng.choice(options)

    def leaf(self, value):
        """`value`, or with the probability of oddity a value that the place does not expect."""
        return self.odd(value) if self.chance(self.oddity) else value

    def odd(self, value):
        if self.chance(0.25):
            value = self.pick(0, 1.5, "text", True, [], {}, [[1]], {"a": {}}, [value], [1, 2, 3])
        if isinstance(value, bool):
            return self.pick(not value, 1, "true", [])
        if isinstance(value, int):
            return self.pick(*WHOLES, value + 1, value - 1, float(value), *NUMBERS)
        if isinstance(value, float):
            return self.pick(*NUMBERS, *WHOLES)
        if isinstance(value, str):
            return self.pick(*TEXTS, value * 2, value.upper(), value[:-1])
        if isinstance(value, list) and value:
            odd = [self.odd(v) if self.chance(0.5) else v for v in value]
            return self.pick(value[:-1], [*value, value[-1]], odd, [value, value], [0 for _ in value], value * 50, [])
        return self.pick({}, [], 0, "text", {"x": 1})

    def real(self, low: float = -2.0, high: float = 2.0) -> float:
        return round(self.rng.uniform(low, high), self.pick(0, 1, 3, 7))

    def reals(self, count: int, low: float = -2.0, high: float = 2.0) -> list[float]:
        return [self.real(low, high) for _ in range(count)]

    def name(self) -> str:
        """A name of letters; often one that was given before."""
        return self.pick("a", "wall", "lamp", "default", "oak", "m 1", "ünï", "0", "x" * self.rng.randint(1, 20))


def shape(g: Grammar) -> tuple[list[list[float]], list[list[int]]]:
    """Vertices and polygons: box, pyramid, plane of squares, fan, loose triangles, one polygon of many corners."""
    kind = g.pick("box", "pyramid", "plane", "fan", "loose", "polygon")
    if kind == "box":
        size = g.reals(3, 0.5, 4.0)
        corners = [[x * size[0], y * size[1], z * size[2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        return corners, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    if kind == "pyramid":
        corners = [[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1], [0.5, g.real(0.5, 2.0), 0.5]]
        return corners, [[0, 1, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]
    if kind == "plane":
        n = g.rng.randint(1, 12)
        points = [[float(i), g.pick(0.0, 0.0, g.real()), float(j)] for i in range(n + 1) for j in range(n + 1)]
        return points, [[k, k + 1, k + n + 2, k + n + 1] for k in range(n * (n + 1)) if k % (n + 1) < n]
    n = g.rng.randint(3, 40) if g.chance(0.95) else g.rng.randint(300, 9000)
    ring = [[math.cos(2 * math.pi * i / n), 0.0, math.sin(2 * math.pi * i / n)] for i in range(n)]
    if kind == "fan":
        return [*ring, [0.0, 1.0, 0.0]], [[i, (i + 1) % n, n] for i in range(n)]
    if kind == "polygon":
        return ring, [list(range(n))]
    count = g.rng.randint(3, 60)
    return [g.reals(3) for _ in range(count)], [g.rng.sample(range(count), 3) for _ in range(g.rng.randint(1, 80))]
