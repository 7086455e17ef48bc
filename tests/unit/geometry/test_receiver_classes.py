"""Borders and classes of receivers."""

from __future__ import annotations

import numpy as np

from gi_core.geometry.receiver_classes import CLASSES, border_receivers, receiver_classes
from gi_core.geometry.surfaces import flatten
from tests.support import scene_builders as build


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
