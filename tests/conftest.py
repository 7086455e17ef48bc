"""Shared by all test files: strict numpy, hypothesis profiles, fixtures over the registries."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from gi_core import defaults
from gi_core.base import threads
from gi_core.base.threads import split
from gi_core.estimators import ESTIMATORS
from gi_core.instruments import compile_ahead
from gi_core.photons import pilot
from tests.support.viewer_fixtures import ctx, draw, few_kernels, folder, gl, play, rough_light  # noqa: F401

settings.register_profile(
    "gi", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
settings.load_profile("gi")


def pytest_configure(config: pytest.Config) -> None:
    """Where Python writes no bytecode, keep that of workers and child processes in the cache of pytest.

    It compiles the program and the tests in each process otherwise: 8 s per worker, 0.3 s per child.
    """
    if sys.dont_write_bytecode and config.pluginmanager.has_plugin("cacheprovider"):
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = str(config.cache.mkdir("bytecode"))


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile all kernels before any test runs, and before workers start: once per machine, 40 s on two cores."""
    if (
        not hasattr(session.config, "workerinput")
        and not session.config.option.collectonly
        and not compile_ahead.is_warm()
    ):
        print("compiling kernels, once per machine: 40 s on two cores", flush=True)
        subprocess.run([sys.executable, "-m", compile_ahead.__name__], stdout=subprocess.DEVNULL, check=True)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that open a window, and begin with their files and slow ones: no worker ends alone with one."""
    for item in items:
        if "play" in getattr(item, "fixturenames", ()):
            item.add_marker("gl")
    first = {item.path for item in items if item.get_closest_marker("slow") or item.get_closest_marker("gl")}
    items.sort(key=lambda item: item.path not in first)


@pytest.fixture(autouse=True)
def numpy_raises():
    """Overflow, invalid operations and divisions by zero are errors in tests."""
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        yield


@pytest.fixture(autouse=True)
def pictures_do_not_wait(monkeypatch):
    """Pictures without a window gather no light unless a test asks for it."""
    monkeypatch.setattr("app.settings.SECONDS", 0.0)


@pytest.fixture(autouse=True)
def bare_meshes_are_coarse(monkeypatch):
    """Bare meshes are refined to 1,000 receivers unless a test asks for more."""
    monkeypatch.setattr("gi_core.files.load.MOST_RECEIVERS", 1000)


@pytest.fixture
def small_shares(monkeypatch):
    """Split work over threads however small it is."""
    monkeypatch.setattr(threads, "split", lambda n, parts, _: split(n, parts, 1))
    monkeypatch.setattr("gi_core.estimators.tangent_plane.CHEAP", 1)


@pytest.fixture(params=ESTIMATORS)
def estimator(request) -> str:
    return request.param


@pytest.fixture(scope="session", autouse=True)
def brief_pilot():
    """Trace 64 pilot photons for a solver of given photons and radius, which chooses nothing.

    The pilot then gives the scene size alone. With all photons it is half the work of most solvers in tests.
    """
    chosen, one_at_a_time = defaults.choose, threading.RLock()

    def brief(model, photons, radius, neighbours):
        with one_at_a_time, pytest.MonkeyPatch.context() as patch:
            if photons is not None and radius is not None:
                patch.setattr(pilot, "PHOTONS", 64)
            try:
                return chosen(model, photons, radius, neighbours)
            finally:
                model.__dict__.pop("pilot", None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gi_core.solver.choose", brief)
        yield
