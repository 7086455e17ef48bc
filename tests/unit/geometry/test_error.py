"""The measures of error on numbers that can be checked by hand, and the classes of receivers."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.geometry.border_angle import border_receivers
from gi_core.geometry.error import CLASSES, error_parts, luminance, noise_of_truth, receiver_classes, relative_error
from gi_core.geometry.surfaces import flatten
from tests.support import scene_builders as build


def grey(*values):
    return np.repeat(np.array(values, float)[:, None], 3, axis=1)


def test_luminance_is_rec_709():
    assert luminance([1.0, 1.0, 1.0]) == pytest.approx(1.0)
    assert luminance(np.eye(3)) == pytest.approx([0.2126, 0.7152, 0.0722])


def test_relative_error_by_hand():
    """|E - T| = 1, 0, 3 with areas 2, 1, 1: l1 = (2 + 3) / (2 * 1 + 2 + 6) = 0.5; l2^2 = (2 + 9) / (2 + 4 + 36)."""
    error = relative_error(grey(2, 2, 3), grey(1, 2, 6), [2, 1, 1])
    assert error.l1 == pytest.approx(0.5)
    assert error.l2 == pytest.approx(np.sqrt(11 / 42))


def test_relative_error_over_some_rows_and_in_the_dark():
    E, T, w = grey(2, 2, 3), grey(1, 2, 6), np.ones(3)
    assert relative_error(E, T, w, np.array([False, True, False])) == (0, 0)
    assert np.isnan(relative_error(E, 0 * T, w)).all()


def test_parts_of_an_error():
    parts = error_parts(grey(1.2), grey(1.1), grey(1.0), [1.0])
    assert parts.noise.l1 == pytest.approx(0.1 / 1.1)
    assert parts.bias.l1 == pytest.approx(0.1)
    assert parts.total.l1 == pytest.approx(0.2)


def test_noise_of_the_truth_is_what_a_noisy_reference_measures_against_itself():
    rng = np.random.default_rng(5)
    T = grey(*np.linspace(1, 3, 4000))
    s = 0.1 * np.ones_like(T)
    noisy = T + 0.1 * rng.normal(size=(4000, 1))
    assert noise_of_truth(s, T, np.ones(4000)) == pytest.approx(relative_error(noisy, T, np.ones(4000)).l1, rel=0.03)


def test_border_of_a_floor_is_its_rim_and_of_a_room_every_edge():
    surfaces, receivers = flatten(build.plane_scene(divisions=4))
    rim = np.abs(receivers.positions[:, :2]).max(axis=1) > 0.99
    assert np.array_equal(border_receivers(surfaces, len(receivers.areas)), rim)
    surfaces, receivers = flatten(build.furnace_scene(divisions=4))
    at_wall = (np.abs(receivers.positions - 0.5) > 0.49).sum(axis=1) > 1
    assert np.array_equal(border_receivers(surfaces, len(receivers.areas)), at_wall)


def test_a_closed_smooth_surface_has_no_border_on_either_side():
    surfaces, receivers = flatten(build.sphere_scene(subdivisions=2))
    assert len(receivers.areas) == 2 * 162
    assert not border_receivers(surfaces, len(receivers.areas)).any()


def test_every_receiver_is_in_exactly_one_class():
    surfaces, receivers = flatten(build.plane_scene(divisions=6, mobiles=(build.box_mobile(),)))
    background = np.ones((len(receivers.areas), 3))
    now = background.copy()
    shaded = (np.abs(receivers.positions[:, :2]) < 0.4).all(axis=1)
    now[shaded] = 0.5
    now[~shaded] = 1.001  # below 1 % of the mean: not affected
    classes = receiver_classes(surfaces, receivers, now, background)
    assert tuple(classes) == CLASSES
    assert (np.sum(list(classes.values()), axis=0) == 1).all()
    static = np.arange(len(shaded)) < surfaces.first_receiver[1]
    assert np.array_equal(classes["mobile"], ~static)
    assert np.array_equal(classes["affected"], static & shaded)
    assert classes["border"].sum() == 24 and classes["untouched"].sum() == 49 - 24 - 9
