"""What the frames of a motion are made of: as many photons as the budget allows, the same ones throughout.

Where the light of mobiles is gathered, half of the budget is that work's: as many paths as fit it.

A prefix of the photons is a valid smaller solution, with more noise. Another prefix has other noise, which the eye
takes for a flicker: so one is chosen when a motion begins, a smaller one only if frames keep missing the budget by
far, a larger one never before the next motion.
"""

from __future__ import annotations

FAR = 1.5  # times the budget: that is missing it by far
FEWEST = 16  # times fewer photons than at rest have four times the noise; beyond that pictures are confetti ...
LEAST = 1 << 14  # ... and so are those of fewer than this: each photon that is cut leaves a dark blot
GATHERING = 0.5  # of the budget, where mobiles gather their light
IN_A_ROW = 4  # frames that do, before fewer photons are taken: one or two are the machine's own hiccups


class Pace:
    """Used by the solver's thread alone, but for `begin` and `budget`."""

    def __init__(self) -> None:
        self.budget = 0.0  # [s] that the light of a frame may take; 0: all photons always
        self._photons: int | None = None
        self._paths: int | None = None
        self._chosen_for: float | None = None  # budget; None: to be chosen anew
        self._late = 0

    def begin(self) -> None:
        """Let the next frame choose: a motion begins."""
        self._chosen_for = None

    def choose(self, solver) -> tuple[int | None, int | None]:
        """Return of how many photons and gathered paths to compute the next frame, as Solver.move_all() takes them."""
        budget, prefixes = self.budget, solver.prefixes
        if budget <= 0 or not prefixes:
            self._photons = self._paths = None
        elif self._chosen_for != budget or self._photons not in prefixes:
            self._paths, self._late = solver.paths_within(GATHERING * budget), 0
            self._photons = max(solver.prefix_within(budget, self._paths), self._good_enough(prefixes)[0])
        self._chosen_for = budget
        return self._photons, self._paths

    def took(self, seconds: float, solver) -> None:
        """Take note of how long the frame took; step down a prefix if it was one too many that was late."""
        if self._photons is None:
            return
        self._late = self._late + 1 if seconds > FAR * self.budget else 0
        smaller = [n for n in self._good_enough(solver.prefixes) if n < self._photons]
        if self._late >= IN_A_ROW and smaller:
            self._photons, self._late = smaller[-1], 0

    @staticmethod
    def _good_enough(prefixes: tuple[int, ...]) -> list[int]:
        return [n for n in prefixes if FEWEST * n >= prefixes[-1] and n >= min(LEAST, prefixes[-1])]
