"""Time of a linear programme of levels: 12 lamps, 200 requirements, random light: `python -m studies.hold`."""

import time

import numpy as np

from gi_core.frames.held_light import Requirements, least_power

POINTS, LAMPS, RUNS = 199, 12, 100


def main() -> None:
    rng, seconds, met = np.random.default_rng(0), [], 0
    for _ in range(RUNS):
        light, watts = rng.gamma(0.7, 60, (POINTS, LAMPS)), rng.uniform(20, 60, LAMPS)
        mean, error = light.mean(axis=0), 0.02 * light
        wanted, U0 = 0.6 * mean.sum(), 0.3
        linear, noise = np.vstack([mean, light - U0 * mean]), np.vstack([error.mean(axis=0) / POINTS**0.5, error])
        asked = np.vstack([np.append(0 * mean, wanted), np.tile(np.append(U0 * mean, 0), (POINTS, 1))])
        target, offset = np.minimum(np.arange(POINTS + 1), 1), np.append(-wanted, np.zeros(POINTS))
        began = time.process_time()
        levels = least_power(
            Requirements(linear, offset, noise, 0 * noise, target, asked), watts, np.ones(LAMPS, bool), 2
        )
        seconds.append(time.process_time() - began)
        met += not levels.missing.any()
    print(f"{1e3 * np.median(seconds):.2f} ms, at most {1e3 * max(seconds):.2f} ms; {met} of {RUNS} have an answer")


if __name__ == "__main__":
    main()
